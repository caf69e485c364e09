"""First passages of photon noise through a level, as in core/sensor/photon_noise.h, in float32."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.reference.filters import SETTLED, at_most, exp_minus, one_minus_exp

FAR = 6.0

_EXP2 = "0x1.c0d85ep-7 0x1.43ef6ap-4 0x1.5bdfb0p-2 0x1.f5df8cp-1 0x1.6a09eap+0"
_RATE = (
    "-0x1.d0e916p-16 0x1.7393aap-12 -0x1.1074b2p-14 -0x1.4b5c98p-7 "
    "-0x1.1341bep-5 -0x1.484658p-3 -0x1.25b848p+0 -0x1.1ba916p-7"
)
_SLOPE = (
    "-0x1.302b28p-14 0x1.36e814p-10 -0x1.204538p-9 -0x1.f1d488p-5 "
    "-0x1.1d8b7cp-2 -0x1.22aef2p+0 -0x1.43b014p-2"
)
_LOSS = (
    "-0x1.3bd722p+1 -0x1.0ffc32p+2 0x1.6cd316p+2 0x1.4ae1dp+3 -0x1.4366ap+2 "
    "-0x1.03d2a6p+4 -0x1.b3b8aep+3 -0x1.27535ep+3 -0x1.6f5184p-2"
)
_f = np.float32


def polynomial(coefficients: str, x: F32) -> F32:
    """A polynomial, its highest power first."""
    first, *rest = (_f(float.fromhex(number)) for number in coefficients.split())
    p = np.full_like(x, first)
    for coefficient in rest:
        p = p * x + coefficient
    return p


def _exp2(log: F32) -> F32:
    above = log + _f(64)
    whole = above.astype(np.int32)
    f = (above - whole.astype(np.float32)) - _f(0.5)
    scale = np.ldexp(_f(1), whole - 64).astype(np.float32)
    value: F32 = scale * polynomial(_EXP2, f)
    return value


def one_pole_rate(x: F32) -> F32:
    """Rate of first passages of a process with one pole at a level, in units of the pole."""
    return _exp2(polynomial(_RATE, x))


def loss_slope(x: F32) -> F32:
    """By how much the loss falls with x, phi / Phi."""
    return _exp2(polynomial(_SLOPE, x))


def passage_loss(x: F32) -> F32:
    """-ln Phi."""
    below = _f(4) - polynomial(_LOSS, x * _f(0.125))
    loss = _f(float.fromhex("0x1.b4c902p+5")) * exp_minus(np.where(below < SETTLED, below, SETTLED))
    return np.where(x < FAR, loss, _f(0))


def shifted_level(shift: F32, x: F32) -> F32:
    """x as seen by a process with one pole."""
    return x + shift / (_f(1) + _f(0.23) * np.where(x > 0, x, _f(0)) * shift)


def passage_rate(shift: F32, x: F32) -> F32:
    """Rate of first passages at a level, in units of the slower pole."""
    level = shifted_level(shift, np.clip(x, _f(-3), _f(7)))
    return np.where(x < FAR, one_pole_rate(np.minimum(level, _f(7))), _f(0))


@dataclass(frozen=True)
class Band:
    """The noise of a pixel at one light."""

    sigma: float
    """log units"""
    decay: float
    """1 / us"""
    slow: float
    """the slower pole, 1 / us"""
    shift: float
    """by how much the faster pole moves a level away, deviations"""

    @classmethod
    def at(cls, sensor: SensorParameters, dn: float) -> Band:
        """At a light, DN."""
        turn = 2.0 * math.pi * 1e-6
        lux = sensor.bright_lux + sensor.dim_lux
        low = turn * sensor.cutoff_hz * sensor.dim_lux / lux
        slope = turn * sensor.cutoff_hz * sensor.lux_per_dn / lux
        first = low + slope * dn if sensor.cutoff_hz else 0.0
        second = turn * sensor.follower_hz
        if first > 0.0 and second > 0.0:
            slow, fast = min(first, second), max(first, second)
            decay = first * second / (first + second)
            shift = 1.43 * math.sqrt(slow / (fast + 0.39 * slow))
        else:
            slow = decay = first or second
            shift = 0.0
        return cls(math.sqrt(sensor.photon_scale_us * decay / dn), decay, slow, shift)

    def keep(self, us: float) -> float:
        """How much memory is left after a time."""
        z = np.array([self.decay * us]).astype(np.float32)
        return 1.0 - float(one_minus_exp(at_most(z, SETTLED))[0])
