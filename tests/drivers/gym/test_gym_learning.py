"""A small learner balances a pole from events alone: its return grows, beyond chance."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from evs.drivers.gym import cross_entropy

pytestmark = [pytest.mark.slow, pytest.mark.statistical]

EVALUATED = range(1000, 1008)
"""Seeds of episodes that the learner never saw."""


@pytest.fixture(scope="module")
def env() -> gymnasium.Env:
    return gymnasium.make(
        "evs.drivers.gym:evs/CartPole-v0", observation="time_surface", tau_us=5e4, max_s=2.0
    )


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.campaign)])
def test_cross_entropy_learns_to_balance_from_events_alone(env: gymnasium.Env, seed: int) -> None:
    # nothing else than an array of events reaches it
    assert env.observation_space.shape == (2, 64, 64)
    learnt = cross_entropy.learn(env, seed, generations=4, population=12, best=3)
    before = np.array([_return(env, np.zeros_like(learnt.weights), one) for one in EVALUATED])
    after = np.array([_return(env, learnt.weights, one) for one in EVALUATED])
    # paired by episode; Student's t of 7 degrees of freedom is over 5.41 by chance once in 2000
    assert _t(after - before) > 5.41
    # the policies of the last generation against those of the first, drawn blindly
    first, last = learnt.returns[0], learnt.returns[-1]
    spread = np.sqrt(first.var(ddof=1) / len(first) + last.var(ddof=1) / len(last))
    # Welch's t of some 11 degrees of freedom is over 2.72 by chance once in 100
    assert (last.mean() - first.mean()) / spread > 2.72
    # it stands to the end of nearly every episode: 2 s are 200 steps, without control some 90
    assert after.mean() > 180 > 120 > before.mean()


def test_the_same_seed_learns_the_same(env: gymnasium.Env) -> None:
    options = {"generations": 2, "population": 2, "best": 1}
    one, other = (cross_entropy.learn(env, 3, **options) for _ in range(2))
    assert np.array_equal(one.weights, other.weights)
    assert np.array_equal(one.returns, other.returns)


def test_features_are_where_things_are_and_where_they_go() -> None:
    surface = np.zeros((2, 64, 64), np.float32)
    assert not cross_entropy.features(surface).any()
    # a bright thing on the right goes further right: ON on its right side, OFF on its left
    surface[1, 10:20, 52:54] = surface[0, 10:20, 44:46] = 1.0
    x, y, right, up = cross_entropy.features(surface)
    assert x > 0.4
    assert y > 0.4
    assert right > 0
    assert up == pytest.approx(0, abs=1e-12)


def _return(env: gymnasium.Env, weights: np.ndarray, seed: int) -> float:
    return cross_entropy.episode(env, weights, seed)


def _t(differences: np.ndarray) -> float:
    return float(differences.mean() / (differences.std(ddof=1) / np.sqrt(len(differences))))
