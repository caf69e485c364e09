"""What another sensor in every episode costs: processor time of a reset, with ranges and without.

`.venv/bin/pytest -m bench -s tests/bench/test_randomise_cost.py` prints the table of
docs/howto/randomise.md. Processor time, since neighbours on the machine move the time on the wall.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import pytest

from evs.drivers.gym import LoopEnv
from evs.drivers.gym.registration import ENVIRONMENTS

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
