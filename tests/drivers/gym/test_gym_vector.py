"""Many environments side by side: in one process and in processes of their own, the same bytes."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import evs.drivers.gym  # noqa: F401 - registers the environments
from reference.episodes import same

OPTIONS: dict[str, Any] = {"size": (24, 20), "max_s": 0.2, "sensor": "dvs128", "encoders": True}


def rollout(environments: Any, steps: int = 30) -> list[Any]:
    """Observations, rewards and ends; over 20 steps, so that every one is reset by itself."""
    random = np.random.default_rng(7)
    told = [environments.reset(seed=4)[0]]
    for _ in range(steps):
        action = random.uniform(-1, 1, environments.action_space.shape).astype(np.float32)
        seen, worth, terminated, truncated, info = environments.step(action)
        told.append((seen, worth, terminated, truncated, info["events"]))
    environments.close()
    return told


@pytest.fixture(scope="module")
def together() -> list[Any]:
    return rollout(gymnasium.make_vec("evs/CartPole-v0", 3, vectorization_mode="sync", **OPTIONS))


def test_they_are_those_of_single_environments(together: list[Any]) -> None:
    env = gymnasium.make("evs/CartPole-v0", **OPTIONS)
    # gymnasium gives the second of them the second seed
    seen, _ = env.reset(seed=5)
    for key, value in seen.items():
        assert np.array_equal(together[0][key][1], value)
    random = np.random.default_rng(7)
    for step in together[1:15]:
        action = random.uniform(-1, 1, (3, 1)).astype(np.float32)
        seen, worth, *_ = env.step(action[1])
        assert all(np.array_equal(step[0][key][1], value) for key, value in seen.items())
        assert step[1][1] == worth
    assert any(step[3].any() for step in together[1:])


@pytest.mark.parametrize("context", ["forkserver", pytest.param("spawn", marks=pytest.mark.slow)])
def test_in_processes_of_their_own_they_say_the_same(together: list[Any], context: str) -> None:
    apart = gymnasium.make_vec(
        "evs/CartPole-v0",
        3,
        vectorization_mode="async",
        vector_kwargs={"context": context},
        **OPTIONS,
    )
    assert same(together, rollout(apart))


@pytest.mark.integration
def test_forked_processes_say_the_same(together: list[Any]) -> None:
    # what gymnasium does by itself on Linux, after this process has found light with threads
    warm = gymnasium.make("evs/CartPole-v0", **{**OPTIONS, "threads": 2})
    warm.reset(seed=1)
    warm.step(np.zeros(1, np.float32))
    apart = gymnasium.make_vec("evs/CartPole-v0", 3, vectorization_mode="async", **OPTIONS)
    assert same(together, rollout(apart))
