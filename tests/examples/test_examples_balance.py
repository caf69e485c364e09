"""Observer and controller of the pencil, against the linear model they are made for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.examples.pencil.balance import (
    FORCE_N,
    FRICTION,
    GRAVITY,
    MASS_KG,
    TICK_S,
    Observer,
    StickBalancer,
    StickGains,
)
from evs.msgs import EvsError


class Rod:
    """The linear model, stepped exactly: tilt'' = w^2 tilt - w^2 / g a, place'' = a."""

    def __init__(self, length_m: float, tilt: float) -> None:
        self.rate = math.sqrt(1.5 * GRAVITY / length_m)
        self.state = np.array([[tilt, -tilt], [0.0, 0.0]])
        self.place, self.speed = np.zeros(2), np.zeros(2)

    def step(self, acceleration: np.ndarray) -> None:
        w = self.rate
        cosh, sinh = math.cosh(w * TICK_S), math.sinh(w * TICK_S)
        rest = np.array([acceleration / GRAVITY, (0.0, 0.0)])
        grown = np.array([[cosh, sinh / w], [sinh * w, cosh]])
        self.state = rest + grown @ (self.state - rest)
        self.place += self.speed * TICK_S + 0.5 * acceleration * TICK_S**2
        self.speed += acceleration * TICK_S


@pytest.mark.parametrize(("every", "late"), [(1, 0), (1, 20), (17, 25), (33, 60)])
def test_the_observer_finds_tilt_and_rate_from_late_and_rare_measurements(
    every: int, late: int
) -> None:
    rod, observer = Rod(0.2, 0.02), Observer(Rod(0.2, 0.0).rate, observer_hz=5.0)
    random, past = np.random.default_rng(0), []
    for tick in range(600):
        acceleration = random.uniform(-2.0, 2.0, 2)
        rod.step(acceleration)
        observer.predict(acceleration)
        past.append(rod.state[0].copy())
        if tick % every == 0 and tick >= late:
            observer.correct(past[tick - late], late * TICK_S, (tick - late) * 1000)
    # 5 Hz for over half a second: e^-15 of the first error, grown to now; the rest is rounding
    growth = math.exp(rod.rate * late * TICK_S)
    np.testing.assert_allclose(observer.past[-1], rod.state, atol=2e-5 * growth)


def test_what_cannot_be_placed_in_time_is_left_out() -> None:
    observer = Observer(8.0, 10.0)
    observer.correct(np.array([0.3, 0.3]), 10.0, 1000)
    observer.correct(np.array([0.3, 0.3]), -0.5, 2000)
    assert not observer.past.any()
    observer.correct(np.array([0.3, 0.3]), 0.0, 3000)
    known = observer.past.copy()
    assert known.any()
    # the same measurement again says nothing new
    observer.correct(np.array([0.5, 0.5]), 0.0, 3000)
    np.testing.assert_array_equal(observer.past, known)


@pytest.mark.parametrize("length_m", [0.2, 0.05])
def test_poles_lie_where_they_were_placed(length_m: float) -> None:
    gains = StickGains(fast=3.0, slow=0.5)
    balancer = StickBalancer(length_m, gains)
    w = math.sqrt(1.5 * GRAVITY / length_m)

    def force(tilt: float, rate: float, place: float, speed: float) -> float:
        balancer.observer.past[-1, :, 0] = tilt, rate
        return float(balancer._force(np.array([place, 0.0]), np.array([speed, 0.0]))[0])

    # small ones, so that no force is held back; what friction takes is not acceleration
    small = 1e-6
    row = [force(*(small * np.eye(4)[k])) / small for k in range(4)]
    row[3] -= FRICTION
    a = np.array(row) / MASS_KG
    system = np.array(
        [[0, 1, 0, 0], [w * w, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0]], np.float64
    ) + np.outer([0.0, -w * w / GRAVITY, 0.0, 1.0], a)
    found = np.sort(np.linalg.eigvals(system).real) / w
    # double poles: rounding moves them by its root
    np.testing.assert_allclose(found, [-3.0, -3.0, -0.5, -0.5], atol=1e-3)


def test_force_is_what_a_motor_can_give() -> None:
    balancer = StickBalancer(0.2)
    force = balancer.decide(0, np.array([1.0, -1.0]), np.zeros(2), np.array([0.5, -0.5]), 0)
    assert np.all(np.abs(force) == FORCE_N)


def test_a_stick_without_length_is_refused() -> None:
    with pytest.raises(EvsError, match="longer than 0 m"):
        StickBalancer(0.0)
