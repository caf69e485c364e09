"""Steps of the Gymnasium environments, 10 ticks at 64 x 64 px, beside the bare loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from evs.drivers.gym import LoopEnv
from evs.drivers.gym.registration import ENVIRONMENTS
from evs.emulator.simulation.stacked_arrays import KINDS
from speed.turns import Table, milliseconds

STEPS = 40
BARE = "evs.ClosedLoop alone"


def env_steps(name: str, kind: str) -> Callable[[], object]:
    """STEPS steps of an environment under the same actions each time."""
    env = LoopEnv(**ENVIRONMENTS[name], observation=kind)
    shape = (STEPS, *env.action_space.shape)
    actions = np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)

    def run() -> None:
        env.reset(seed=1)
        for action in actions:
            env.step(action)

    return run


def bare_steps(name: str) -> Callable[[], object]:
    """The same ticks without an environment around them."""
    env = LoopEnv(**ENVIRONMENTS[name])
    shape = (STEPS, *env.action_space.shape)
    actions = np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)

    def run() -> None:
        env.reset(seed=1)
        for action in actions:
            env.loop.step(env._task.control(action), 10)

    return run


@pytest.mark.bench
def test_steps_of_the_environments() -> None:
    columns = {}
    for name in ("evs/CartPole-v0", "evs/Reach-v0"):
        calls = {BARE: bare_steps(name)} | {kind: env_steps(name, kind) for kind in KINDS}
        columns[name] = {row: time / STEPS for row, time in milliseconds(calls, 7).items()}
    print(Table("a step of 10 ticks, 64 x 64 px, one thread", columns, dict.fromkeys(KINDS, BARE)))
    for name, times in columns.items():
        print(f"{name}: {1e3 / times['event_frame'].median:.0f} steps/s with event frames")
    assert all(times[kind].median > 0 for times in columns.values() for kind in KINDS)
