"""Delayed tilts to forces: an observer of the stick and a controller of the cart.

A thin rod of length L on a cart with acceleration a falls as

    tilt'' = w^2 tilt - k a        w^2 = 3 g / (2 L),  k = w^2 / g

for small tilts. x and y are alike and independent, so all arrays are (2,).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs.examples.pencil.line_tracker import F64
from evs.msgs import EvsError

GRAVITY = 9.81
MASS_KG = 0.27
"""cart and pencil, since the motors push both"""
FRICTION = 0.5
"""of the rails, N s/m"""
FORCE_N = 5.0
"""largest force of a motor"""
TICK_S = 0.001
"""period of the controller"""
TICKS = 256
"""greatest age of a measurement, ticks"""


@dataclass(frozen=True)
class StickGains:
    """Gains of the controller. The study tunes them for every tracker; the defaults suit events.

    Poles are in units of the stick's own rate w, so they suit sticks of any length.
    """

    fast: float = 1.9
    """poles that catch the stick"""
    slow: float = 0.5
    """poles that bring the cart back to the middle"""
    observer_hz: float = 45.0
    """bandwidth of the observer"""
    lag_ms: float = 3.5
    """how much older than its stamp a measurement is"""


class Observer:
    """Estimates tilt and rate now from older measurements and the acceleration of the cart."""

    def __init__(self, rate: float, observer_hz: float) -> None:
        """Begin with an upright stick at rest.

        Args:
            rate: w of the stick, 1/s.
            observer_hz: bandwidth.
        """
        self._rate = rate
        self._pole = 2.0 * math.pi * observer_hz
        # how an error now grows in 0, 1, ... ticks: (TICKS, 2, 2)
        angles = rate * TICK_S * np.arange(TICKS)
        cosh, sinh = np.cosh(angles), np.sinh(angles)
        self._growth = np.moveaxis(np.array([[cosh, sinh / rate], [sinh * rate, cosh]]), 2, 0)
        self.past = np.zeros((TICKS, 2, 2))
        """(TICKS, tilt and rate, axis), the last one is now"""
        self._measured_us: int | None = None

    def predict(self, acceleration: F64) -> None:
        """Predict one tick, in which the cart had this acceleration, m/s^2 (2,)."""
        rest = np.array([acceleration / GRAVITY, (0.0, 0.0)])
        now = rest + self._growth[1] @ (self.past[-1] - rest)
        self.past[:-1] = self.past[1:]
        self.past[-1] = now

    def correct(self, tilt: F64, age_s: float, stamp_us: int) -> None:
        """Correct by an older measurement, whose error is propagated until now.

        Args:
            tilt: (2,) rad.
            age_s: age of the measurement.
            stamp_us: time of the measurement.
        """
        age = round(age_s / TICK_S)
        if not 0 <= age < TICKS:
            return
        since_s = 0.001 if self._measured_us is None else (stamp_us - self._measured_us) * 1e-6
        self._measured_us = stamp_us
        if since_s <= 0.0:
            return
        # both poles of the error from one measurement to the next at exp(-pole since_s)
        z = math.exp(-self._pole * since_s)
        cosh, sinh = math.cosh(self._rate * since_s), math.sinh(self._rate * since_s)
        gain = 1.0 - z * z
        rate_gain = (2.0 * cosh - 2.0 * z - cosh * gain) * self._rate / sinh
        error = tilt - self.past[-1 - age, 0]
        change = np.array([gain * error, rate_gain * error])
        self.past[TICKS - 1 - age :] += self._growth[: age + 1] @ change


class StickBalancer:
    """Forces that keep the stick upright and the cart in the middle."""

    def __init__(self, length_m: float, gains: StickGains | None = None) -> None:
        """Place the poles of the linear model: two at -fast w, two at -slow w.

        Args:
            length_m: of the stick.
            gains: of the controller and its observer.

        Raises:
            EvsError: the length is not positive.
        """
        if not length_m > 0.0:
            raise EvsError(f"length_m is {length_m}: a stick is longer than 0 m")
        self.gains = gains or StickGains()
        square = 1.5 * GRAVITY / length_m
        rate = math.sqrt(square)
        fast, slow = self.gains.fast * rate, self.gains.slow * rate
        # (s + fast)^2 (s + slow)^2 = s^4 + a3 s^3 + a2 s^2 + a1 s + a0
        a3, a0 = 2.0 * (fast + slow), (fast * slow) ** 2
        a2, a1 = fast**2 + slow**2 + 4.0 * fast * slow, 2.0 * fast * slow * (fast + slow)
        # compare with s^2 (s^2 - w^2) + k (tilt + rate s) s^2 - (place + speed s) (s^2 - w^2)
        place, speed = a0 / square, a1 / square
        self._place, self._speed = place, speed
        self._tilt = (a2 + square + place) * GRAVITY / square
        self._rate = (a3 + speed) * GRAVITY / square
        self.observer = Observer(rate, self.gains.observer_hz)
        self._velocity: F64 | None = None

    def decide(
        self, t_us: int, position: F64, velocity: F64, tilt: F64 | None = None, stamp_us: int = 0
    ) -> F64:
        """(2,) N for the next tick; call it once a tick.

        Args:
            t_us: time of the decision.
            position: (2,) of the motors' encoders, m.
            velocity: (2,) of the motors' encoders, m/s.
            tilt: (2,) rad, if there is a new measurement.
            stamp_us: time of the measurement.
        """
        before = velocity if self._velocity is None else self._velocity
        self._velocity = velocity
        # the encoders give the acceleration of the cart, whatever force acted
        self.observer.predict((velocity - before) / TICK_S)
        if tilt is not None:
            age_s = (t_us - stamp_us) * 1e-6 + self.gains.lag_ms * 1e-3
            self.observer.correct(tilt, age_s, stamp_us)
        return self._force(position, velocity)

    def _force(self, position: F64, velocity: F64) -> F64:
        tilt, rate = self.observer.past[-1]
        acceleration = (
            self._tilt * tilt + self._rate * rate + self._place * position + self._speed * velocity
        )
        force = MASS_KG * acceleration + FRICTION * velocity
        held: F64 = np.clip(force, -FORCE_N, FORCE_N)
        return held
