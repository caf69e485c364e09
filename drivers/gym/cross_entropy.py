"""The cross-entropy method on events: the smallest learner that balances a pole, to be copied.

    import gymnasium
    from evs.drivers.gym import cross_entropy

    env = gymnasium.make("evs.drivers.gym:evs/CartPole-v0", observation="time_surface", tau_us=5e4)
    learnt = cross_entropy.learn(env, seed=1)
    print(learnt.returns.mean(axis=1))                   # of each generation
    print(cross_entropy.episode(env, learnt.weights, seed=99))

Rubinstein 1999; de Boer et al., "A tutorial on the cross-entropy method", 2005: draw policies from
a Gaussian, try each, move the Gaussian to the best of them, again. A policy here is a matrix of
few numbers, since four moments of a time surface show where a thing is and how it moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

FEATURES = 4
"""how many numbers `features` returns"""

FRESH_PX = 32.0
"""fresh pixels that count as 1 in the moments of motion"""


@dataclass(frozen=True)
class Learnt:
    """The result of `learn`."""

    weights: F64
    """(nu, FEATURES) the policy: the mean of the last generation's best"""
    returns: F64
    """(generations, population) return of each policy that was tried"""


def features(surface: npt.NDArray[np.float32]) -> F64:
    """Moments of a time surface.

    Args:
        surface: (2, h, w) time surface.

    Returns:
        (4,) the centre of all fresh events (x right, y up, half of the picture is 1), then the
        same moments of ON minus OFF, which point where a bright thing moves and grow with its
        speed.
    """
    off, on = surface.astype(np.float64)
    height, width = on.shape
    x = (np.arange(width) + 0.5) / width * 2.0 - 1.0
    y = 1.0 - (np.arange(height) + 0.5) / height * 2.0
    every, change = on + off, on - off
    # without events the centre is the picture's
    mass = every.sum() + 1.0
    return np.array(
        [
            (every.sum(axis=0) @ x) / mass,
            (every.sum(axis=1) @ y) / mass,
            (change.sum(axis=0) @ x) / FRESH_PX,
            (change.sum(axis=1) @ y) / FRESH_PX,
        ]
    )


def episode(env: Any, weights: F64, seed: int) -> float:
    """Run one episode.

    Args:
        env: An environment whose observation is a time surface.
        weights: (nu, FEATURES) the policy.
        seed: Of the reset.

    Returns:
        The sum of the rewards.
    """
    surface, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        action = np.clip(weights @ features(surface), -1.0, 1.0).astype(np.float32)
        surface, reward, terminated, truncated, _ = env.step(action)
        total += float(reward)
        over = terminated or truncated
    return total


def learn(
    env: Any,
    seed: int,
    *,
    generations: int = 5,
    population: int = 16,
    best: int = 4,
    spread: float = 2.0,
) -> Learnt:
    """Improve a linear policy from events alone.

    Args:
        env: An environment with observation "time_surface" and Box actions.
        seed: Determines everything that is drawn.
        generations: How many generations to try.
        population: Policies in each.
        best: How many of them the next generation follows.
        spread: Standard deviation of the first generation's weights.

    Returns:
        The policy and all returns.
    """
    random = np.random.default_rng(seed)
    shape = (env.action_space.shape[0], FEATURES)
    mean, deviation = np.zeros(shape), np.full(shape, spread)
    returns = []
    for generation in range(generations):
        tried = mean + deviation * random.standard_normal((population, *shape))
        # all policies of a generation start in the same place
        start = int(random.integers(2**31))
        found = np.array([episode(env, weights, start) for weights in tried])
        elite = tried[np.argsort(-found, kind="stable")[:best]]
        mean = elite.mean(axis=0)
        # a little is added, less and less, so that it does not settle too early
        deviation = elite.std(axis=0) + spread * 0.2 * (1.0 - generation / generations)
        returns.append(found)
    return Learnt(mean, np.array(returns))
