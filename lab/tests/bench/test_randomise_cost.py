"""What another sensor or scene in every episode costs: processor time of a reset.

`.venv/bin/pytest -m bench -s lab/tests/bench/test_randomise_cost.py` prints the tables of
docs/howto/randomise.md and docs/howto/randomise_scenes.md. Processor time, since neighbours on the
machine move the time on the wall.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from evs.drivers.gym import LoopEnv
from evs.drivers.gym.registration import ENVIRONMENTS
from evs.emulator import Worlds
from evs.emulator.config import SensorConfig
from reference.memory import resident_bytes

SCENES = Path(__file__).parents[3] / "config/scenes"
ROUNDS = 40
RANGES = {
    "pos_thres": "uniform(0.15, 0.35)",
    "neg_thres": "normal(1, 0.1) * pos_thres",
    "sigma_thres": "normal(0.03, 0.01)",
    "cutoff_hz": "log_uniform(300, 3000)",
    "leak_rate_hz": "log_uniform(0.03, 0.3)",
    "shot_noise_rate_hz": "log_uniform(0.3, 3)",
    "white_lux": "log_uniform(10, 10000)",
    "readout.row_ns": "choice(50, 100, 200)",
}
SCENE = {
    "light.*.brightness": "uniform(0.3, 1)",
    "geom.*.rgb": "uniform(0.1, 1)",
    "body.*.mass": "uniform(0.5, 2) * nominal",
    "joint.*.damping": "uniform(0, 0.1)",
    "camera.*.pos": "normal(0, 0.01) + nominal",
    "camera.*.fovy": "uniform(60, 70)",
    "joint.*.qpos": "uniform(-0.05, 0.05)",
}
PHYSICS = {key: SCENE[key] for key in ("body.*.mass", "joint.*.damping", "joint.*.qpos")}


def milliseconds(call: Callable[[int], Any], rounds: int) -> float:
    """The median of a call's processor time, ms."""
    taken = []
    for number in range(rounds + 1):
        begin = time.process_time()
        call(number)
        taken.append(1e3 * (time.process_time() - begin))
    # the first is not counted
    return statistics.median(taken[1:])


@pytest.mark.bench
@pytest.mark.parametrize("size", [(64, 64), (346, 260)])
def test_cost_of_another_sensor(size: tuple[int, int]) -> None:
    options: dict[str, Any] = {**ENVIRONMENTS["evs/CartPole-v0"], "sensor": "davis346"}
    options |= {"size": size, "threads": 1}
    plain, ranged = LoopEnv(**options), LoopEnv(**options, randomise=RANGES)
    assert ranged.ranges is not None
    draw = ranged.ranges.draw
    rows = {
        "a reset, the same sensor": milliseconds(lambda n: plain.reset(seed=n), ROUNDS),
        f"a reset, {len(RANGES)} keys drawn": milliseconds(lambda n: ranged.reset(seed=n), ROUNDS),
        "of which the draw": milliseconds(lambda n: draw(n), ROUNDS),
        "another environment": milliseconds(lambda _: LoopEnv(**options).reset(seed=1), 5),
        "a step of 10 ticks": milliseconds(lambda _: ranged.step([0.0]), 20),
    }
    print(f"\nCPU ms, {size[0]} x {size[1]} px, davis346, one thread")
    for name, spent in rows.items():
        print(f"{name:28s}{spent:8.2f}")
    # it does not compile the model nor build the scene again
    assert rows[f"a reset, {len(RANGES)} keys drawn"] < rows["another environment"]


@pytest.mark.bench
@pytest.mark.parametrize("size", [(64, 64), (346, 260)])
def test_cost_of_another_scene(size: tuple[int, int]) -> None:
    options: dict[str, Any] = {**ENVIRONMENTS["evs/CartPole-v0"], "sensor": "ideal"}
    options |= {"size": size, "threads": 1}
    plain = LoopEnv(**options)
    whole, physics = (
        LoopEnv(**options, randomise={"scene": ranges}) for ranges in (SCENE, PHYSICS)
    )
    assert whole.scene_ranges is not None
    draw = whole.scene_ranges.draw
    count = len(draw(0).values)
    rows = {
        "a reset, the same scene": milliseconds(lambda n: plain.reset(seed=n), ROUNDS),
        "a reset, masses and starts": milliseconds(lambda n: physics.reset(seed=n), ROUNDS),
        f"a reset, {count} numbers drawn": milliseconds(lambda n: whole.reset(seed=n), ROUNDS),
        "of which the draw": milliseconds(lambda n: draw(n), ROUNDS),
        "another environment": milliseconds(lambda _: LoopEnv(**options).reset(seed=1), 5),
    }
    print(f"\nCPU ms, {size[0]} x {size[1]} px, ideal, one thread")
    for name, spent in rows.items():
        print(f"{name:28s}{spent:8.2f}")
    # it does not compile the model
    assert rows[f"a reset, {count} numbers drawn"] < rows["another environment"]


@pytest.mark.bench
def test_cost_of_worlds_with_models_of_their_own() -> None:
    count = 64
    sensor = SensorConfig("ideal", width=64, height=64)
    shared, own = (Worlds(SCENES / "cartpole.xml", count, threads=1) for _ in range(2))
    # all look and move alike
    scene = {"body.pole.mass": float(shared.model.body("pole").mass[0])}

    def start(_: int, data: Any) -> None:
        data.joint("hinge").qpos[0] = 0.05

    for worlds in (shared, own):
        worlds.add_camera("onboard", sensor=sensor)
        worlds.reset(1, start=start)
        worlds.step(ticks=10)
    before = resident_bytes()
    own.reset(1, scene=scene, start=start)
    own.step(ticks=10)
    megabytes = (resident_bytes() - before) / count / 1e6
    shared.reset(1, start=start)
    shared.step(ticks=10)
    spent: dict[str, list[float]] = {"one model": [], "64 models": []}
    for _ in range(9):
        for name, worlds in zip(spent, (shared, own), strict=True):
            begin = time.process_time()
            worlds.step(ticks=10)
            spent[name].append(1e3 * (time.process_time() - begin))
    print(f"\nCPU ms, {count} worlds of 64 x 64 px, one thread; MB a model: {megabytes:.2f}")
    for name, taken in spent.items():
        print(f"a step of 10 ticks, {name:12s}{statistics.median(taken):8.2f}")
    assert megabytes < 5.0
