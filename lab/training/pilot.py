"""The pilot pass: a cheap rendering of a scene, which decides whether to use it and which pixels.

A few frames of half the size, evenly spread over the scene, are traced with 4 fixed samples and
averaged over 3 x 3 of their pixels. A pixel's score is the sum of the changes of its log light from
frame to frame, in thresholds; changes below MOVES are noise and count as 0, and the score ends at
MOST.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evs.emulator.base.scene import F32, F64, I32
from evs_lab.training.settings import WHITE_DN, Variant
from evs_lab.training.traced_scene import TracedScene

FRAMES = 16
SHRINK = 2
PILOT_VARIANT = Variant(4, "fixed")
THRESHOLD = 0.2
MOVES, MOST = 0.5, 20.0
"""thresholds"""

DARKEST_DN, BRIGHTEST_DN = 0.5, 3000.0
"""A scene is not useful if 99 % of it is darker, or half of it is brighter."""
FASTEST_PX_S = 20_000.0
"""nor if half of what is seen is faster: the camera touches something"""
STILL = 0.01
"""A scene is nearly still if a smaller share of its pixels changes."""


@dataclass(frozen=True)
class Pilot:
    """Result of the pilot pass over a scene."""

    score: F64
    """(h, w) of the small image"""
    light_dn: F32
    """(frames, h, w)"""
    speed: F32
    """(frames, h, w) px/s in the whole image, NaN where nothing is seen"""

    @property
    def is_still(self) -> bool:
        """Whether hardly anything changes."""
        return bool(np.mean(self.score > 0) < STILL)

    @property
    def is_useful(self) -> bool:
        """Whether it is neither black nor overexposed nor too fast."""
        dark, bright = np.percentile(self.light_dn, 99), np.percentile(self.light_dn, 50)
        seen = self.speed[np.isfinite(self.speed)]
        fast = seen.size and float(np.median(seen)) > FASTEST_PX_S
        return bool(dark >= DARKEST_DN and bright <= BRIGHTEST_DN and not fast)


def run_pilot(traced: TracedScene, seed: int) -> Pilot:
    """Trace the pilot frames.

    Args:
        traced: the scene.
        seed: of their noise.
    """
    renderer = traced.renderer(PILOT_VARIANT, seed, SHRINK)
    last = len(traced.snapshots) - 1
    chosen = sorted({round(k * last / (FRAMES - 1)) for k in range(FRAMES)})
    light, speed = [], []
    for tick in chosen:
        snapshot = traced.snapshots[tick]
        pose = snapshot.cameras[0]
        light.append(_blurred(WHITE_DN * renderer.render(snapshot, pose)))
        # motion over one tick: from the tick before, or to the one after
        first = traced.snapshots[max(0, tick - 1)]
        second = traced.snapshots[max(1, tick)]
        flow = renderer.ground_truth(second, second.cameras[0], (first, first.cameras[0])).flow
        speed.append(SHRINK * np.hypot(flow[..., 0], flow[..., 1]))
    dn = np.stack(light)
    # linlog of e, as the pixels have it
    log = np.where(dn < np.e, dn / np.e, np.log(np.maximum(dn, np.e)))
    steps = np.abs(np.diff(log, axis=0)) / THRESHOLD
    score = np.sum(np.where(steps < MOVES, 0.0, steps), 0)
    return Pilot(np.minimum(score, MOST), dn, np.stack(speed).astype(np.float32))


def choose_pixels(pilot: Pilot, count: int, rng: np.random.Generator) -> I32:
    """Choose pixels of the full image, none twice: half of them anywhere, half by their score.

    Where too few pixels have a score, the rest lies anywhere too.

    Returns:
        (count, 2) columns and rows.
    """
    height, width = (SHRINK * side for side in pilot.score.shape)
    score = np.kron(pilot.score, np.ones((SHRINK, SHRINK))).ravel()
    order = rng.permutation(height * width)
    anywhere = order[: count - count // 2]
    score[anywhere] = 0.0
    wanted = min(count // 2, int(np.count_nonzero(score)))
    moving = np.zeros(0, np.intp)
    if wanted:
        moving = rng.choice(len(score), wanted, replace=False, p=score / score.sum())
    rest = order[len(anywhere) :]
    rest = rest[~np.isin(rest, moving)][: count - len(anywhere) - wanted]
    places = np.concatenate([anywhere, moving, rest])
    return np.stack([places % width, places // width], 1).astype(np.int32)


def _blurred(image: F32) -> F32:
    """The mean over 3 x 3 pixels; the border repeats."""
    height, width = image.shape
    wide = np.pad(image, 1, mode="edge")
    parts = [wide[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.asarray(sum(parts[1:], parts[0]) / np.float32(9), np.float32)
