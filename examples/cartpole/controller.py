"""The controller: events and encoders in, the control of the motor out.

It tracks the pole in the events, predicts it with the equation of a falling rod, corrects the
prediction by the tracker, and feeds the state back with four placed poles of the linear model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.examples.cartpole.tracker import PoleTracker
from evs.msgs import Observation

F64 = npt.NDArray[np.float64]

GRAVITY = 9.81


@dataclass(frozen=True)
class Plant:
    """Known parameters of gymnasium's inverted pendulum."""

    mass_kg: float = 15.5
    """cart and pole: the motor moves both"""
    pole_m: float = 0.6
    """length of the pole, a rod"""
    gear: float = 100.0
    """N of a control of 1; the encoder counts as many for a metre"""
    control: float = 3.0
    """largest control of the motor"""


@dataclass(frozen=True)
class CartPoleGains:
    """Where the poles of the linear model lie, in units of the pole's own rate."""

    fast: float = 1.5
    """two poles that catch the pole"""
    slow: float = 0.5
    """two poles that bring the cart back"""
    observer_hz: float = 10.0
    """bandwidth of the observer"""


class CartPoleController:
    """Keeps the pole up and the cart in the middle: `decide` at each Observation."""

    def __init__(self, plant: Plant | None = None, gains: CartPoleGains | None = None) -> None:
        self.plant, self.gains = plant or Plant(), gains or CartPoleGains()
        self._tracker = PoleTracker()
        # a thin rod on a cart with acceleration a: angle'' = w^2 (angle - a / g)
        self._square = 1.5 * GRAVITY / self.plant.pole_m
        self._feedback = feedback(self._square, self.gains)
        self.angle, self.rate = 0.0, 0.0
        """estimate of the pole, rad and rad/s"""
        self._t_us, self._speed = 0, 0.0

    def decide(self, observation: Observation) -> F64:
        """(1,) the motor's control, for the next tick."""
        place, speed = (
            observation.position[0] / self.plant.gear,
            observation.velocity[0] / self.plant.gear,
        )
        for packet in observation.packets:
            self._tracker.update(packet.events)
        self._observe(1e-6 * (observation.t_us - self._t_us), speed)
        self._t_us = observation.t_us
        wanted = self._feedback @ (self.angle, self.rate, place, speed)
        control = self.plant.mass_kg * wanted / self.plant.gear
        return np.clip([control], -self.plant.control, self.plant.control)

    def _observe(self, dt_s: float, speed: float) -> None:
        """Predict the pole over the time step, then correct it by the tracker."""
        acceleration = (speed - self._speed) / dt_s if dt_s > 0.0 else 0.0
        self._speed = speed
        self.rate += self._square * (self.angle - acceleration / GRAVITY) * dt_s
        self.angle += self.rate * dt_s
        # both poles of the error at -2 pi observer_hz
        pole = 2.0 * math.pi * self.gains.observer_hz
        error = self._tracker.angle - self.angle
        self.angle += 2.0 * pole * dt_s * error
        self.rate += (pole * pole + self._square) * dt_s * error


def feedback(square: float, gains: CartPoleGains) -> F64:
    """(4,) acceleration of the cart for angle, rate, place and speed: m/s^2 for rad, rad/s, m, m/s.

    Ackermann's formula written out for angle'' = w^2 angle - (w^2 / g) a, place'' = a, with poles
    twice at -fast w and twice at -slow w.

    Args:
        square: w^2.
        gains: where the poles lie.
    """
    w = math.sqrt(square)
    fast, slow = gains.fast * w, gains.slow * w
    # (s + fast)^2 (s + slow)^2 = s^4 + a3 s^3 + a2 s^2 + a1 s + a0
    a3, a0 = 2.0 * (fast + slow), (fast * slow) ** 2
    a2, a1 = fast**2 + slow**2 + 4.0 * fast * slow, 2.0 * fast * slow * (fast + slow)
    place, speed = a0 / square, a1 / square
    g = GRAVITY / square
    return np.array([(a2 + square + place) * g, (a3 + speed) * g, place, speed])
