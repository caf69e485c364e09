"""How a membrane that nothing reaches decays: e^(-m dt / tau) for any number m of ticks at once.

Two table entries a pixel: m = 256 high + low. The tables are made of correctly rounded operations
only (`decimal` has the one exponential), so that they have the same bits on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Context, Decimal
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.msgs import EvsError

LOW_TICKS = 256
HIGH_ENTRIES = 4096
LEAST = 2.0**-100
"""what is left below is 0: no denormal comes in"""

I64 = np.ndarray[Any, np.dtype[np.int64]]


@dataclass(frozen=True, eq=False)
class Decay:
    """V after m ticks is (V * low[m % 256]) * high[m // 256]; 0 beyond the table."""

    low: F32
    """(256,) float32, d^0 ... d^255"""
    high: F32
    """(4096,) float32, d^0, d^256, d^512, ..."""

    def __call__(self, v: F32, ticks: I64) -> F32:
        """`v` (n,) after `ticks` (n,) >= 0 of its own each, rounded twice to float32."""
        place = np.minimum(ticks // LOW_TICKS, HIGH_ENTRIES - 1)
        high = np.where(ticks < LOW_TICKS * HIGH_ENTRIES, self.high[place], np.float32(0))
        out: F32 = v * self.low[ticks % LOW_TICKS] * high
        return out


def decay_per_tick(tau_s: float, tick_us: int) -> float:
    """d = e^(-dt / tau), correctly rounded."""
    exact = Context(prec=60)
    tau_us = exact.multiply(Decimal(tau_s), Decimal(10**6))
    return float(exact.exp(exact.divide(Decimal(-tick_us), tau_us)))


def decay_tables(tau_s: float, tick_us: int) -> Decay:
    """The tables. Raises EvsError where tau is so long that something is left at their end."""
    d = decay_per_tick(tau_s, tick_us)
    low = _powers(d, LOW_TICKS)
    step = float(low[-1]) * d
    if step**HIGH_ENTRIES >= LEAST:
        longest_s = LOW_TICKS * HIGH_ENTRIES * tick_us * 1e-6 / 69.4
        raise EvsError(
            f"tau_s is {tau_s:g}; in ticks of {tick_us} us make it at most {longest_s:.3g} s"
        )
    return Decay(_rounded(low), _rounded(_powers(step, HIGH_ENTRIES)))


def _powers(base: float, count: int) -> F64:
    """base^0 ... base^(count - 1), each the one before times base."""
    factors = np.full(count, base, np.float64)
    factors[0] = 1.0
    return np.multiply.accumulate(factors)


def _rounded(powers: F64) -> F32:
    return np.where(powers < LEAST, 0.0, powers).astype(np.float32)
