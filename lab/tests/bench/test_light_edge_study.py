"""What more samples of `path` at the edges of geoms are worth: events against converged light.

The room and the robots of test_light_noise_study.py, an ant, and the pencil. The camera stands or
pans at 170 px/s. All metrics leave out the first 20 ms. The tables of
lab/docs/sampling.md are what `.venv/bin/pytest -m bench -s
lab/tests/bench/test_light_edge_study.py` prints, in about ten minutes.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator.config import RenderConfig
from evs.emulator.render import make_renderer
from evs.msgs import Events
from reference.film import VIEWS, model_of
from reference.judged_film import JudgedFilm

WIDTH, HEIGHT, TICKS, SETTLED_US = 112, 84, 61, 20_000
PENCIL = Path(__file__).parents[3] / "config/scenes/pencil.xml"
SCENES = ["room", "gymnasium/ant", "gymnasium/humanoid", "dm_control/humanoid",
          "dm_control/cartpole", "pencil"]  # fmt: skip
EDGES = {"spp": 16, "antialiasing": "adaptive"}
LIGHTS: dict[str, dict[str, object]] = {
    "4 fixed": {"spp": 4},
    "4, 16 at edges": EDGES,
    "16 fixed": {"spp": 16},
    "cycle of 4 x 4": {"spp": 4, "seeds": "cycle"},
    "cycle of 4 x 4, 4 x 16 at edges": {**EDGES, "seeds": "cycle"},
    "cycle of 4 x 16": {"spp": 16, "seeds": "cycle"},
}
SEEDS = (3, 4, 5)
LATE_US = 1500
"""of a cycle of four ticks"""


def shoot(film: JudgedFilm, seed: int, **render: object) -> np.ndarray:
    config = RenderConfig(**{"renderer": "path", "sky": "light", **render})  # type: ignore[arg-type]
    return film.light_by(make_renderer(film.scene, film.camera, config, 2, seed=seed))[0]


def in_time(events: Events, render: dict[str, object]) -> Events:
    """Subtract the delay of a cycle from the stamps."""
    events = events.copy()
    events["t"] -= LATE_US * (render.get("seeds") == "cycle")
    return events


Cells = dict[tuple[str, str, str], tuple[float, float, float]]
"""(camera, light, scene) -> EMD, recall and precision, means over the seeds"""


@pytest.fixture(scope="module")
def cells() -> Iterator[Cells]:
    """The scores of all cases; tables are printed after the last one."""
    found: Cells = {}
    yield found
    for motion in dict.fromkeys(camera for camera, _, _ in found):
        print(f"\nEMD (recall, precision), camera: {motion}\n| | {' | '.join(SCENES)} |")
        for light in dict.fromkeys(name for camera, name, _ in found if camera == motion):
            cells = [found[motion, light, s] for s in SCENES if (motion, light, s) in found]
            row = [f"{emd:.3g} ({recall:.2f}, {right:.2f})" for emd, recall, right in cells]
            print(f"| {light} | {' | '.join(row)} |")


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("motion", ["still", "pan"])
@pytest.mark.parametrize("name", SCENES)
def test_more_samples_at_edges(
    name: str, motion: str, robot_files: dict[str, Path], cells: Cells
) -> None:
    pencil = name == "pencil"
    model = mujoco.MjModel.from_xml_path(str(PENCIL)) if pencil else model_of(name, robot_files)
    film = JudgedFilm(model, motion, WIDTH, HEIGHT, TICKS, VIEWS.get(name))
    halves = [shoot(film, seed, spp=256) for seed in (1, 2)]
    truth = film.events_of((halves[0] + halves[1]) / 2)

    def score(*streams: Events) -> tuple[float, float, float]:
        compared = [film.compare(events, truth, SETTLED_US) for events in streams]
        means = np.mean([(c.emd, c.recall, c.precision) for c in compared], 0)
        return float(means[0]), float(means[1]), float(means[2])

    cells[motion, "no event at all", name] = score(truth[:0])
    for light, render in LIGHTS.items():
        shot = [film.events_of(shoot(film, seed, **render)) for seed in SEEDS]
        cells[motion, light, name] = score(*(in_time(events, render) for events in shot))
    between = film.compare(film.events_of(halves[0]), film.events_of(halves[1]), SETTLED_US)
    cells[motion, "the reference's halves", name] = (
        between.emd, between.recall, between.precision
    )  # fmt: skip
    # where a still camera sees motion, edges make most of the false events
    if motion == "still" and len(truth) > 1000:
        assert cells[motion, "4, 16 at edges", name][0] < cells[motion, "4 fixed", name][0]
