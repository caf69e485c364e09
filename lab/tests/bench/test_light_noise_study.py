"""Which samples serve an event camera: events of `path` with few samples against converged light.

The scenes are a softly lit room (a glowing ball, a bulb, an even sky, one mirror) with a pendulum
in it, and robots from gymnasium and dm_control whose lamps become bulbs with a radius of a tenth of
their distance. The camera stands still, pans at 170 px/s or slides at 0.5 m/s. All metrics leave
out the first 20 ms, in which a running mean settles. lab/docs/sampling.md shows the tables
that `.venv/bin/pytest -m bench -s lab/tests/bench/test_light_noise_study.py` prints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.config import RenderConfig
from evs.emulator.render import make_renderer
from evs.emulator.sensor.running_mean import running_mean
from evs_lab.metrics.compare import Comparison
from reference.film import VIEWS, model_of
from reference.judged_film import JudgedFilm

WIDTH, HEIGHT, TICKS, SETTLED_US = 56, 42, 61, 20_000
SCENES = ["room", "gymnasium/humanoid", "dm_control/humanoid", "dm_control/cartpole"]
MOTIONS = ["still", "pan", "slide"]
STRATEGIES = {
    "fresh, random": ("fresh", "random"),
    "fresh, owen": ("fresh", "owen"),
    "fixed, random": ("fixed", "random"),
    "fixed, global": ("fixed", "global"),
    "fixed, sobol": ("fixed", "sobol"),
    "fixed, owen": ("fixed", "owen"),
    "fixed, anchored": ("fixed", "anchored"),
}
MEAN, HALVES = "fresh, owen, running mean", "half owen, half anchored"
SEEDS = (3, 4, 5)


@dataclass(frozen=True)
class Score:
    """The events of one strategy against those of converged light, as means over the seeds."""

    emd: float
    recall: float
    precision: float
    static_hz: float
    late_us: float
    events: float


Found = dict[tuple[str, int], Score]
"""(strategy, samples per pixel) -> score"""


def score(*of_seeds: Comparison) -> Score:
    rows = [
        (c.emd, c.recall, c.precision, c.spurious.static_rate_hz, c.timing.median_us, c.events)
        for c in of_seeds
    ]
    return Score(*(float(mean) for mean in np.mean(rows, axis=0)))


def film_of(name: str, motion: str, files: dict[str, Path], soft: bool = True) -> JudgedFilm:
    """Return the film of a scene.

    Args:
        name: "room", or the name of a robot in `files`.
        motion: How the camera moves: one of MOTIONS.
        files: Name of each robot -> its MJCF file.
        soft: Whether the robots' lamps become bulbs.
    """
    return JudgedFilm(model_of(name, files, soft), motion, WIDTH, HEIGHT, TICKS, VIEWS.get(name))


def shoot(film: JudgedFilm, seed: int, **render: object) -> F32:
    """Render the film with `path`: luminance, (ticks, h, w) float32."""
    config = RenderConfig(**{"renderer": "path", "sky": "light", **render})  # type: ignore[arg-type]
    return film.light_by(make_renderer(film.scene, film.camera, config, 2, seed=seed))[0]


def lights(film: JudgedFilm, spp: int, seed: int) -> dict[str, F32]:
    """Return the light of every strategy at `spp` samples per pixel."""
    found = {
        name: shoot(film, seed, spp=spp, seeds=seeds, sampler=sampler)
        for name, (seeds, sampler) in STRATEGIES.items()
    }
    found[MEAN] = running_mean(found["fresh, owen"])
    if spp > 1:
        owen, anchored = (
            shoot(film, seed + 10, spp=spp // 2, sampler=s) for s in ("owen", "anchored")
        )
        found[HALVES] = (owen + anchored) / 2
    return found


def line(c: Score) -> str:
    return (
        f"EMD {c.emd:7.3f}  recall {c.recall:.2f}  precision {c.precision:.2f}"
        f"  static {c.static_hz:7.2f} Hz  late {c.late_us:5.0f} us  events {c.events:.0f}"
    )


def in_short(cases: list[tuple[str, Found]]) -> str:
    """Summarise each strategy over all scenes.

    A cell holds the EMD as a share of the default's (geometric mean), and recall and precision
    (means).

    Args:
        cases: (motion, scores) of the scenes in which something happens.
    """
    lines = []
    for way, spp in cases[-1][1]:
        columns = []
        for motion in MOTIONS:
            found = [f for m, f in cases if m == motion]
            if not found:
                continue
            emd = [f[way, spp].emd / f["fixed, owen", spp].emd for f in found]
            recall, precision = (
                np.mean([getattr(f[way, spp], share) for f in found])
                for share in ("recall", "precision")
            )
            columns.append(f"{np.exp(np.mean(np.log(emd))):6.2f} ({recall:.2f}, {precision:.2f})")
        lines.append(f"  {spp:3d} {way:26}" + "  ".join(columns))
    return "\n".join(lines)


@pytest.fixture(scope="module")
def cases() -> Iterator[list[tuple[str, Found]]]:
    """The scores of all cases; a summary is printed after the last one."""
    seen: list[tuple[str, Found]] = []
    yield seen
    if seen:
        print(f"\nEMD beside fixed, owen (recall, precision): {', '.join(MOTIONS)}")
        print(in_short(seen))


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", SCENES)
def test_events_of_each_way_to_sample(
    name: str, motion: str, robot_files: dict[str, Path], cases: list[tuple[str, Found]]
) -> None:
    film = film_of(name, motion, robot_files)
    converged = 1024 if name == "room" else 512
    one, two = (film.events_of(shoot(film, seed, spp=converged)) for seed in (1, 2))
    own = film.compare(two, one, SETTLED_US)
    print(
        f"\n{name}, {motion}: {converged} samples, against another such run\n  {line(score(own))}"
    )
    silence = film.compare(one[:0], one, SETTLED_US).emd
    print(f"  without any event EMD {silence:.3f}")
    direct = shoot(film, 0, renderer="direct", spp=4)
    print(f"  direct,  4 {'hard light instead':26} "
          f"{line(score(film.compare(film.events_of(direct), one, SETTLED_US)))}")  # fmt: skip
    found: Found = {}
    for spp in (1, 4, 16):
        of_seeds: dict[str, list[Comparison]] = {}
        for seed in SEEDS:
            for way, light in lights(film, spp, seed).items():
                c = film.compare(film.events_of(light), one, SETTLED_US)
                of_seeds.setdefault(way, []).append(c)
        for way, comparisons in of_seeds.items():
            found[way, spp] = score(*comparisons)
            print(f"  path, {spp:4d} {way:26} {line(found[way, spp])}", flush=True)
    emd = {key: c.emd for key, c in found.items()}
    static = {key: c.static_hz for key, c in found.items()}
    for spp in (1, 4):
        assert emd["fixed, owen", spp] < emd["fresh, owen", spp] / 1.2
        # a running mean is late when the camera pans
        assert motion == "pan" or emd[MEAN, spp] < emd["fresh, owen", spp] / 1.2
    if motion == "still":
        assert static["fixed, owen", 4] < 1
        assert static["fixed, owen", 4] < static["fresh, owen", 4] / 10
    if own.reference_events >= 50:
        cases.append((motion, found))
        # the reference is precise enough to tell the strategies apart
        assert own.emd < emd["fixed, owen", 16] / 2
        # fewer samples are worse
        assert emd["fixed, owen", 16] < emd["fixed, owen", 4] < emd["fixed, owen", 1]
        # and noise that moves with the surfaces is worse than noise that does not
        if motion != "still":
            assert emd["fixed, owen", 4] < min(emd[HALVES, 4], emd["fixed, anchored", 4])
