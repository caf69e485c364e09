"""The whole controller: events and encoders in, the motor's control out. It knows nothing else.

It finds the pole in the events, believes in a rod that falls by its own equation, corrects that by
what is found, and places four poles of the linear model.
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
    """What is known of gymnasium's inverted pendulum beside its events."""

    mass_kg: float = 15.5
    """cart and pole: the motor moves both"""
    pole_m: float = 0.6
    """length of the pole, a rod"""
    gear: float = 100.0
    """N of a control of 1; the encoder counts as many for a metre"""
    control: float = 3.0
    """the most that the motor takes"""


@dataclass(frozen=True)
class Gains:
    """Where the poles of the linear model lie, in units of the pole's own rate."""

    fast: float = 1.5
    """two poles that catch the pole"""
    slow: float = 0.5
    """two poles that bring the cart back"""
    observer_hz: float = 10.0
    """how fast what is believed follows what is seen"""


class Balancer:
    """Keeps the pole up and the cart in the middle: `decide` at each Observation."""

    def __init__(self, plant: Plant | None = None, gains: Gains | None = None) -> None:
        self.plant, self.gains = plant or Plant(), gains or Gains()
        self._tracker = PoleTracker()
        # a thin rod on a cart with acceleration a: angle'' = w^2 (angle - a / g)
        self._square = 1.5 * GRAVITY / self.plant.pole_m
        self._feedback = feedback(self._square, self.gains)
        self.angle, self.rate = 0.0, 0.0
        """what is believed of the pole, rad and rad/s"""
        self._t_us, self._speed = 0, 0.0

    def decide(self, seen: Observation) -> F64:
        """(1,) the motor's control, for the next tick."""
        place, speed = seen.position[0] / self.plant.gear, seen.velocity[0] / self.plant.gear
        for packet in seen.packets:
            self._tracker.see(packet.events)
        self._observe(1e-6 * (seen.t_us - self._t_us), speed)
        self._t_us = seen.t_us
        wanted = self._feedback @ (self.angle, self.rate, place, speed)
        control = self.plant.mass_kg * wanted / self.plant.gear
        return np.clip([control], -self.plant.control, self.plant.control)

    def _observe(self, dt_s: float, speed: float) -> None:
        """The pole fell for so long while the cart came to this speed; then look where it is."""
        acceleration = (speed - self._speed) / dt_s if dt_s > 0.0 else 0.0
        self._speed = speed
        self.rate += self._square * (self.angle - acceleration / GRAVITY) * dt_s
        self.angle += self.rate * dt_s
        # both poles of the error at -2 pi observer_hz
        pole = 2.0 * math.pi * self.gains.observer_hz
        error = self._tracker.angle - self.angle
        self.angle += 2.0 * pole * dt_s * error
        self.rate += (pole * pole + self._square) * dt_s * error


def feedback(square: float, gains: Gains) -> F64:
    """(4,) acceleration of the cart for angle, rate, place and speed: m/s^2 for rad, rad/s, m, m/s.

    Ackermann's formula written out for angle'' = w^2 angle - (w^2 / g) a, place'' = a, with poles
    twice at -fast w and twice at -slow w. In: square, w^2.
    """
    w = math.sqrt(square)
    fast, slow = gains.fast * w, gains.slow * w
    # (s + fast)^2 (s + slow)^2 = s^4 + a3 s^3 + a2 s^2 + a1 s + a0
    a3, a0 = 2.0 * (fast + slow), (fast * slow) ** 2
    a2, a1 = fast**2 + slow**2 + 4.0 * fast * slow, 2.0 * fast * slow * (fast + slow)
    place, speed = a0 / square, a1 / square
    g = GRAVITY / square
    return np.array([(a2 + square + place) * g, (a3 + speed) * g, place, speed])
