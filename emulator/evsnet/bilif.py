"""BiLIF, the bipolar leaky integrate-and-fire unit (the paper's equations 3 and 4), per pixel.

    charge  V' = d V + I           d = e^(-dt / tau)
    fire    n events: ON if V' >= V_on, OFF if V' <= -V_off, else none
    reset   V  = V' - n V_on, V' + n V_off or V'

In the paper, n is 1: what a large step leaves over V_on fires in the ticks after it, one by one
(the saturation effect). With EVENTS_PER_TICK["many"], n is the number of thresholds in V', at most
64; only what is left over those fires later. The paper has V_on = V_off = 1; here they are the
sensor's thresholds in units of the network's.

A pixel without current and between its thresholds is not touched: its V is that of tick `last`, and
is decayed in one go when something reaches it. So leaving pixels out changes no bit. For any number
m of ticks e^(-m dt / tau) is the product of two table entries: m = 256 high + low. The tables are
made of correctly rounded operations only (`decimal` has the one exponential), so that they have the
same bits on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Context, Decimal
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.msgs import Events, EvsError, make_events, unknown

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
            f"tau_s is {tau_s:g}; with ticks of {tick_us} us, it can be at most {longest_s:.3g} s"
        )
    return Decay(_rounded(low), _rounded(_powers(step, HIGH_ENTRIES)))


def _powers(base: float, count: int) -> F64:
    """base^0 ... base^(count - 1), each the one before times base."""
    factors = np.full(count, base, np.float64)
    factors[0] = 1.0
    return np.multiply.accumulate(factors)


def _rounded(powers: F64) -> F32:
    return np.where(powers < LEAST, 0.0, powers).astype(np.float32)


MAX_POTENTIAL = np.float32(64)
"""|V'| is clamped to it, so that no trail is longer than 64 thresholds"""


EVENTS_PER_TICK = {"one": 1, "many": 64}
"""model.events_per_tick -> most events of a pixel in a tick"""


def most_events(name: str) -> int:
    """The most events of a pixel in a tick. Raises EvsError where no rule has that name."""
    if name not in EVENTS_PER_TICK:
        raise unknown("number of events per tick", name, EVENTS_PER_TICK)
    return EVENTS_PER_TICK[name]


@dataclass(frozen=True, eq=False)
class BiLIF:
    """The unit's two thresholds, its decay, and how often it fires."""

    on: np.float32
    """V_on"""
    off: np.float32
    """V_off, > 0"""
    decay: Decay
    most: int = 1
    """events of a pixel in a tick; what is left stays in V"""

    def step(
        self, current: F32, v: F32, last: I64, tick: int, begin_us: int, tick_us: int
    ) -> tuple[Events, int]:
        """Step all pixels by one tick.

        Args:
            current: (h, w). NaN, which no checked network gives, counts as 0 and as clamped.
            v: (h, w) membrane potentials, changed in place.
            last: (h, w) the tick that each v is as of, changed in place.
            tick: Number of the tick.
            begin_us: Where it begins, us.
            tick_us: Its length, us.

        Returns:
            The events, sorted by t, ties in pixel order, then in order of crossing; how many |V'|
            were clamped.
        """
        width = v.shape[1]
        flat_v, flat_last = v.reshape(-1), last.reshape(-1)
        active = (current != 0) | (v >= self.on) | (v <= -self.off)
        pixels = np.flatnonzero(active)
        lost = np.isnan(current.reshape(-1)[pixels])
        charge = np.where(lost, np.float32(0), current.reshape(-1)[pixels])

        before = self.decay(flat_v[pixels], tick - flat_last[pixels])
        unclamped = before + charge
        after = np.clip(unclamped, -MAX_POTENTIAL, MAX_POTENTIAL)
        up, down = after >= self.on, after <= -self.off
        # thresholds in V', at least 1 where it fires
        inside = np.where(up, after / self.on, -after / self.off)
        count = np.trunc(np.minimum(inside, np.float32(self.most)))
        reset = np.where(down, after + count * self.off, after)
        flat_v[pixels] = np.where(up, after - count * self.on, reset)
        flat_last[pixels] = tick
        clamped = int(np.count_nonzero(lost | (after != unclamped)))

        fired = np.flatnonzero(up | down)
        each = count[fired].astype(np.int64)
        fired = np.repeat(fired, each)
        # 1 ... n of each pixel
        number = np.arange(1.0, len(fired) + 1.0) - np.repeat(np.cumsum(each) - each, each)
        threshold = np.where(up[fired], np.float64(self.on), -np.float64(self.off))
        offset = crossing_us(number, threshold, before[fired], charge[fired], tick_us)
        order = np.argsort(offset, kind="stable")
        where, polarity = pixels[fired][order], up[fired][order]
        stamps = begin_us + offset[order]
        return make_events(stamps, where % width, where // width, polarity), clamped


def crossing_us(number: F64, threshold: F64, before: F32, charge: F32, tick_us: int) -> I64:
    """When a membrane that goes from `before` in a line by `charge` crosses threshold `number`.

    A membrane that was there already has what a large step left, and fires in every tick. What it
    has beyond whole thresholds is the share of the tick that remains: so the stamps of many pixels
    spread evenly, and those of one are about a tick apart.

    Args:
        number: (n,) 1, 2 ...
        threshold: (n,) V_on, or -V_off.
        before: (n,) V at the start of the tick.
        charge: (n,) of the tick.
        tick_us: Length of the tick.

    Returns:
        (n,) us after the start of the tick, rounded up, 1 ... tick_us, as core/sensor/comparator.h
        crossing_time.
    """
    start, level = before.astype(np.float64), number * threshold
    missing = np.where(level > 0, level - start > 0, level - start < 0) & (charge != 0)
    inside = start / threshold
    part = np.where(missing, level - start, 1.0 - (inside - np.floor(inside)))
    span = np.where(missing, charge.astype(np.float64), 1.0)
    exact = part * np.float64(tick_us) / span
    offset: I64 = np.ceil(np.clip(exact, 1.0, np.float64(tick_us))).astype(np.int64)
    return offset
