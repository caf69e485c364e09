"""Video from the events of each model, against the true frames: the paper's Real2Sim test.

Whole small pictures instead of spread pixels. Each model gets light of the kind that it is meant
for: fixed seeds for the pixels, a cycle and fresh ones of the fewest samples besides, and for a
network fresh seeds of the samples that it was trained on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from evs.drivers.run.report import versions
from evs.emulator.base.scene import F32, F64, I32
from evs.emulator.sensor.pixel import log_light
from evs.emulator.world import versions as emulator_versions
from evs.msgs import Events, EvsError
from evs_lab.evaluation import models, scenes
from evs_lab.evaluation.claims import NOTHING, REFERENCE
from evs_lab.evaluation.clip import PAN_PX_S, SIZE, TICK_US, Clip, make_clip
from evs_lab.evaluation.clip_light import HALF_SEEDS, WARM, LightSpec, NoisyLight, light_of
from evs_lab.evaluation.evaluate import EvaluationSettings, Moved, look_ahead, run_on
from evs_lab.evaluation.light_cache import LightCache
from evs_lab.reconstruction import (
    VideoNetwork,
    complementary_filter,
    correlation,
    equalise,
    laplacian_energy,
    ssim,
)

PICTURE_TICKS = 20
"""ms between two pictures"""
TRUTH_TIMES = 8
"""how many times the samples of the reference a true frame has"""
LOG_STEP, IMAGE_STEP = 0.02, 1 / 255
"""grey values are rounded to: log units, and what 8 bits make of 0 ... 1"""
FILTER, TRUTH = "filter", "truth"
PX = (128, 96)

SETTINGS = EvaluationSettings(
    scenes=("gymnasium/ant", "gymnasium/humanoid", "procedural/0"),
    cameras=("pan",),
    spp=(4, 16),
    models=("plain", "adaptive", "evsnet_c8", "paper"),
    pixels=PX[0] * PX[1],
    reference_spp=64,
    size=PX,
    patch_px=0,
)
QUICK = replace(
    SETTINGS,
    scenes=scenes.QUICK[:1],
    spp=(4,),
    models=SETTINGS.models[:3],
    ticks=200,
    reference_spp=16,
)
"""A first impression."""


@dataclass(frozen=True)
class Reconstructor:
    """Something that makes video of events."""

    name: str
    video: Callable[[Events, Sequence[int]], F64]
    """events with x and y, times in us -> (times, height, width)"""
    step: float
    """grey values of its pictures are rounded to it"""


@dataclass(frozen=True)
class PictureMeasures:
    """How like the true frames the pictures of one reconstructor are; a value for each time."""

    ssim: list[float]
    correlation: list[float]
    lpa: list[float]
    """energy of the Laplacian, 1000 DN^2"""


@dataclass(frozen=True)
class VideoCell:
    """One model on one light of one clip."""

    scene: str
    camera: str
    light: str
    model: str
    events_hz: float
    """events per pixel and s"""
    measures: dict[str, PictureMeasures]
    """by reconstructor"""
    pictures: dict[str, F64]
    """by reconstructor: (h, w) 0 ... 1, the last one, equalised"""


@dataclass(frozen=True)
class VideoEvaluation:
    """Everything that was measured."""

    command: str
    settings: dict[str, Any]
    versions: dict[str, str]
    reconstructors: list[str]
    cells: list[VideoCell] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)


def reconstructors(
    settings: EvaluationSettings, network: VideoNetwork | None
) -> list[Reconstructor]:
    """The filter, and a network that there may be."""
    width, height = settings.size

    def filtered(events: Events, times_us: Sequence[int]) -> F64:
        return complementary_filter(
            events, (height, width), times_us, models.sensor_of(1).pos_thres
        )

    found = [Reconstructor(FILTER, filtered, LOG_STEP)]
    if network is not None:
        found.append(Reconstructor(network.name, network.video, IMAGE_STEP))
    return found


def picture_ticks(settings: EvaluationSettings) -> list[int]:
    """Ticks at which pictures are made.

    Raises:
        EvsError: too few ticks for one.
    """
    ticks = list(range(PICTURE_TICKS, settings.ticks, PICTURE_TICKS))
    if not ticks:
        raise EvsError(f"ticks is {settings.ticks}; give {PICTURE_TICKS + 1} or more for a picture")
    return ticks


def judged_ticks(settings: EvaluationSettings) -> list[int]:
    """Those of the second half, in which reconstructors have settled."""
    ticks = picture_ticks(settings)
    return ticks[len(ticks) // 2 :]


def cases(
    tested: Sequence[models.ModelUnderTest], spp: Sequence[int]
) -> Iterator[tuple[LightSpec, models.ModelUnderTest]]:
    """Each model with each light that it is meant for."""
    for one in tested:
        pixel = one.name in models.PIXELS
        for samples in one.meant_for(spp):
            yield LightSpec("path", samples, "fixed" if pixel else "fresh"), one
        for seeds in ("cycle", "fresh") if pixel else ():
            yield LightSpec("path", min(spp), seeds), one


def work(settings: EvaluationSettings, tested: Sequence[models.ModelUnderTest]) -> int:
    """Samples a pixel and tick of it all: the length of its progress bar."""
    clips = len(settings.scenes) * len(settings.cameras)
    ticks = settings.ticks + look_ahead(tested)
    noisy = {spec for spec, _ in cases(tested, settings.spp)}
    traced = sum(spec.spp * (ticks + WARM * (spec.seeds == "fresh")) for spec in noisy)
    truth = TRUTH_TIMES * len(judged_ticks(settings))
    return clips * (traced + settings.reference_spp * (settings.ticks + truth))


def evaluate_video(
    settings: EvaluationSettings,
    cache: LightCache,
    tested: Sequence[models.ModelUnderTest],
    by: Sequence[Reconstructor],
    moved: Moved | None = None,
    command: str = "",
) -> VideoEvaluation:
    """Run the evaluation. Rendered light stays in the cache, even after an error.

    Args:
        settings: what is evaluated; every pixel of its pictures is traced.
        cache: holds the light.
        tested: the models.
        by: the reconstructors.
        moved: called with the progress.
        command: the command line, for the report.
    """
    setups = [scenes.scene_setup(name) for name in settings.scenes]
    result = VideoEvaluation(
        command, settings.plain(), {**versions(), **emulator_versions()}, [one.name for one in by]
    )
    done = 0
    for setup in setups:
        for motion in settings.cameras:
            clip = make_clip(
                setup,
                motion,
                settings.ticks + look_ahead(tested),
                sampled=settings.pixels,
                patch_px=settings.patch_px,
                size=settings.size,
                seed=settings.seed,
                # the angle of the other table's pan, on a smaller picture
                pan_px_s=PAN_PX_S * settings.size[1] / SIZE[1],
            )

            def step(samples: int, what: str = clip.name) -> None:
                nonlocal done
                done += samples
                if moved is not None:
                    moved(done, what)

            result.cells.extend(_judge(clip, settings, cache, tested, by, step))
    return result


def _judge(
    clip: Clip,
    settings: EvaluationSettings,
    cache: LightCache,
    tested: Sequence[models.ModelUnderTest],
    by: Sequence[Reconstructor],
    step: Callable[[int], None],
) -> Iterator[VideoCell]:
    """All cells of one clip."""
    ticks, threads, spp = settings.ticks, settings.threads, settings.reference_spp
    shown = replace(clip, instants=tuple(clip.instants[k] for k in judged_ticks(settings)))
    count = len(shown.instants)
    exact = LightSpec("path", TRUTH_TIMES * spp, seed=HALF_SEEDS[1])
    light = light_of(shown, shown.fingerprint(count), exact, count, cache, threads, step)
    truth = [
        equalise(image_of(frame, clip.pixels, settings.size), LOG_STEP)
        for frame in log_light(light, models.sensor_of(1))
    ]
    times_us = [TICK_US * k for k in picture_ticks(settings)]

    def cell(light: str, model: str, events: Events) -> VideoCell:
        placed = events.copy()
        placed["x"], placed["y"] = clip.pixels[events["x"]].T
        measures, pictures = {}, {}
        for one in by:
            made = one.video(placed, times_us)[-count:]
            equal = [equalise(picture, one.step) for picture in made]
            measures[one.name] = measured(equal, truth)
            pictures[one.name] = equal[-1]
        seconds = 1e-6 * TICK_US * (ticks - 1)
        inside = np.count_nonzero(events["t"] <= TICK_US * (ticks - 1))
        hz = inside / (len(clip.pixels) * seconds)
        return VideoCell(clip.scene_name, clip.motion, light, model, hz, measures, pictures)

    own = measured(truth, truth)
    yield VideoCell(
        clip.scene_name, clip.motion, f"{exact.spp} fixed", TRUTH, float("nan"),
        {one.name: own for one in by}, {one.name: truth[-1] for one in by},
    )  # fmt: skip
    calm = LightSpec("path", spp, seed=HALF_SEEDS[0])
    light = light_of(clip, clip.fingerprint(ticks), calm, ticks, cache, threads, step)
    reference = models.reference_events(light, threads)
    yield cell(f"{spp} fixed", REFERENCE, reference)
    yield cell("none", NOTHING, reference[:0])
    noisy = NoisyLight(clip, ticks + look_ahead(tested), cache, threads, step)
    kept: dict[LightSpec, tuple[F32, F32 | None]] = {}
    for spec, one in cases(tested, settings.spp):
        if spec not in kept:
            kept[spec] = noisy.of(spec)
        yield cell(f"{spec.spp} {spec.seeds}", one.name, run_on(one, spec, *kept[spec]).events)


def image_of(values: F32, pixels: I32, size: tuple[int, int]) -> F64:
    """(h, w) picture of the values (n,) of all its pixels, (n, 2) columns and rows."""
    width, height = size
    image = np.empty((height, width))
    image[pixels[:, 1], pixels[:, 0]] = values
    return image


def measured(made: Sequence[F64], truth: Sequence[F64]) -> PictureMeasures:
    """Compare equalised pictures with the equalised true frames of the same times."""
    pairs = list(zip(made, truth, strict=True))
    return PictureMeasures(
        ssim=[ssim(*pair, span=1.0) for pair in pairs],
        correlation=[correlation(*pair) for pair in pairs],
        lpa=[1e-3 * laplacian_energy(picture) for picture in made],
    )
