"""The plain pixel in NumPy, written for reading: the oracle of core/sensor/pixel.h, byte for byte.

It imports nothing native. Every float32 step of core/base/vmath.h and core/sensor/logmap.h is
repeated here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evs.emulator.scene import F32, F64
from evs.emulator.sensor.fixed_pattern import draw_pattern
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.state import PlainState, check_tick
from evs.msgs import Events, make_events

_BLACK = np.float32(2.0**-64)
"""Light closer to zero than this is black."""
_LN_FIT = (
    "0x1.1457aep-4 -0x1.de3c22p-4 0x1.e6f06ep-4 -0x1.fc2206p-4 0x1.233768p-3 "
    "-0x1.555c4ep-3 0x1.99a4b6p-3 -0x1.000006p-2 0x1.555548p-2"
)
_P = [np.float32(float.fromhex(number)) for number in _LN_FIT.split()]
_LN2_HIGH = np.float32(float.fromhex("0x1.62e4p-1"))
_LN2_LOW = np.float32(float.fromhex("0x1.7f7d1cp-20"))


def natural_log(x: F32) -> F32:
    """ln of normal, positive, finite float32 of any shape."""
    bits = x.view(np.int32)
    exponent = (bits - np.int32(0x3F3504F3)) >> 23
    f = (bits - (exponent << 23)).view(np.float32) - np.float32(1)
    p = np.full_like(f, _P[0])
    for coefficient in _P[1:]:
        p = p * f + coefficient
    square = f * f
    tail = square * f * p - np.float32(0.5) * square
    e = exponent.astype(np.float32)
    high = e * _LN2_HIGH
    total = high + f
    rest = f - (total - high)
    out: F32 = total + (rest + (e * _LN2_LOW + tail))
    return out


def log_light(luminance: F32, sensor: SensorParameters) -> F32:
    """L_log (h, w); NaN where the luminance is negative, NaN or Inf."""
    with np.errstate(over="ignore", invalid="ignore"):
        light = np.where(np.abs(luminance) < _BLACK, np.float32(0), luminance)
        dn = light * np.float32(sensor.exposure_dn) + np.float32(sensor.dark_dn)
    usable = (light >= 0) & (dn <= np.finfo(np.float32).max)
    safe: F32 = np.where(usable, dn, np.float32(1)).astype(np.float32)
    if sensor.log == "log_eps":
        mapped = natural_log(safe / np.float32(255) + np.float32(sensor.log_eps))
    else:
        knee = np.array([sensor.linlog_dn], np.float32)
        ln_knee = natural_log(knee)
        above = natural_log(np.maximum(safe, knee).astype(np.float32))
        mapped = np.where(safe >= knee, above, np.minimum(ln_knee / knee * safe, ln_knee))
    return np.where(usable, mapped, np.float32(np.nan))


class ReferenceModel:
    """EventModel with the bytes of PlainModel, and none of its speed."""

    def __init__(self, sensor: SensorParameters) -> None:
        self.sensor = sensor

    def init(self, seed: int) -> PlainState:
        """The state before the first tick."""
        return PlainState.dark(seed, self.sensor)

    def step(
        self, luminance: F32, state: PlainState, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, PlainState]:
        """As PlainModel.step; this one leaves the state handed in as it was."""
        check_tick(self.sensor, luminance, state, t_begin_us, t_end_us)
        state = state.copy()
        mapped = log_light(luminance, self.sensor)
        usable = ~np.isnan(mapped)
        state.clamped += int(np.count_nonzero(~usable))
        now: F64 = np.where(usable, mapped, state.last_log).astype(np.float64)
        last: F64 = state.last_log.astype(np.float64)

        # the first light sets the reference, rounded to a multiple of 2^-43
        first = np.isnan(state.reference)
        state.reference[first] = np.round(now[first] * 2.0**43) / 2.0**43

        # all pixels' k-th crossing at once, as long as one pixel has a k-th crossing
        theta = draw_pattern(self.sensor, state.seed)
        tick_us = t_end_us - t_begin_us
        found: list[
            tuple[np.ndarray[Any, Any], ...]
        ] = []  # (offset_us, pixel, k, polarity) each (n,)
        for polarity, sign, thresholds in ((1, 1.0, theta.on), (0, -1.0, theta.off)):
            for k in range(1, 1 << 20):
                level = state.reference + sign * thresholds.astype(np.float64)
                reached = (level <= now) if polarity else (level >= now)
                if not reached.any():
                    break
                part, span = (level - last)[reached], (now - last)[reached]
                offset = np.clip(np.ceil(part * tick_us / span), 1, tick_us).astype(np.int64)
                pixel = np.flatnonzero(reached)
                found.append((offset, pixel, np.full_like(pixel, k), np.full_like(pixel, polarity)))
                state.reference[reached] = level[reached]

        state.clock_us += tick_us
        state.tick_us = tick_us
        state.ticks += 1
        state.last_log = np.where(usable, mapped, state.last_log)
        state.last_luminance = np.where(usable, luminance, state.last_luminance)
        if not found:
            return make_events([], [], [], []), state

        # by time, then pixel, then order of crossing
        offsets, pixels, ks, p = (np.concatenate(column) for column in zip(*found, strict=True))
        order = np.lexsort((ks, pixels, offsets))
        y, x = np.divmod(pixels[order], self.sensor.width)
        return make_events(t_begin_us + offsets[order], x, y, p[order]), state
