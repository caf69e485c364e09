"""The two poles between log light and comparators: core/sensor/lowpass.h.

One pole is y' = w (x - y). All steps are float32, in the order of the formulas.
"""

from __future__ import annotations

import math

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.reference.light import LN2_HIGH, LN2_LOW, natural_log

SETTLED = np.float32(80.0)
"""z from which on nothing of the old value is left"""
FOR_EVER = np.float32(2.0**100)
"""the largest z"""
FADED = np.float32(2.0**-64)
"""a filter closer to 0 is 0, log units"""
STRAIGHT = np.float32(2.0**-20)
"""z below which a pole bends nothing inside a tick"""
SLOWEST = np.float32(2.0**-90)
"""a z below this does not move the large-signal photoreceptor"""
NEAR = np.float32(0.046875)
"""z below which b comes from its series"""


def share_of_tick(hz: float, tick_us: int) -> np.float32:
    """2 pi f dt; 0 where it would be a denormal float32."""
    return per_tick(2.0 * math.pi * 1e-6 * hz, tick_us)


def per_tick(per_us: float, tick_us: int) -> np.float32:
    """A rate per us in a tick, float32; 0 where it would be a denormal."""
    rate = np.float32(per_us * float(tick_us))
    return rate if rate >= np.finfo(np.float32).tiny else np.float32(0)


def bandwidth(sensor: SensorParameters, dn: F32, tick_us: int) -> F32:
    """z = 2 pi f dt of the photoreceptor at this light: f is a line over DN."""
    turn = 2.0 * math.pi * 1e-6 * sensor.cutoff_hz
    lux = sensor.bright_lux + sensor.dim_lux
    in_the_dark = per_tick(turn * sensor.dim_lux / lux, tick_us)
    for_each_dn = per_tick(turn * sensor.lux_per_dn / lux, tick_us)
    with np.errstate(over="ignore", under="ignore"):
        z: F32 = in_the_dark + for_each_dn * dn
    return z


def shares(z: F32) -> tuple[F32, F32]:
    """(a, b) of a tick: how far y comes towards where x was, how much of x's line it follows.

    a = 1 - e^-z and b = 1 - a / z, float32 as z; a NaN counts as infinite.
    """
    most = np.where(z < FOR_EVER, z, FOR_EVER)
    z = at_most(z, SETTLED)
    a = one_minus_exp(z)
    with np.errstate(under="ignore"):
        # (e^-z - 1 + z) / z = z / 2 - z^2 / 6 + ...
        near = (np.float32(0.5) - (np.float32(1 / 6) - np.float32(1 / 24) * z) * z) * z
    far = np.float32(1) - a / np.maximum(most, NEAR)
    return a, np.where(z < NEAR, near, far)


def exp_parts(z: F32) -> tuple[F32, F32]:
    """e^-z for 0 <= z <= 80 as scale + scale rest: z = k ln 2 - r, scale = 2^-k, rest = e^r - 1."""
    k = (z * np.float32(math.log2(math.e)) + np.float32(0.5)).astype(np.int32)
    whole = k.astype(np.float32)
    r = (whole * LN2_HIGH - z) + whole * LN2_LOW
    scale = np.ldexp(np.float32(1), -k).astype(np.float32)
    with np.errstate(under="ignore"):
        series = _horner(r, [1.0 / math.factorial(n) for n in range(6, 0, -1)])
        return scale, series * r


def one_minus_exp(z: F32) -> F32:
    """1 - e^-z for 0 <= z <= 80."""
    scale, rest = exp_parts(z)
    with np.errstate(under="ignore"):
        out: F32 = (np.float32(1) - scale) - scale * rest
    return out


def exp_minus(z: F32) -> F32:
    """e^-z for 0 <= z <= 80."""
    scale, rest = exp_parts(z)
    out: F32 = scale + scale * rest
    return out


def large_signal(z: F32, y0: F32, x0: F32, x1: F32) -> F32:
    """The large-signal photoreceptor's next value: core/sensor/lowpass.h."""
    one, zero = np.float32(1), np.float32(0)
    with np.errstate(all="ignore"):
        z = at_most(np.where(np.abs(z) < SLOWEST, zero, z), FOR_EVER)
        s = x1 - x0
        m = z - s
        v = np.where(m < 0, -m, zero) - (x1 - y0)
        # what is taken out of the exponentials, so that none vanishes or overflows
        least = np.where(z < -v, z, -v)
        shift = np.where(least > 64, least - np.float32(64), zero)
        over = np.where(v > SETTLED, v - SETTLED, zero)

        size = at_most(m, FOR_EVER)
        short = size < np.float32(2.0**-24)
        mean = one_minus_exp(at_most(size, SETTLED)) / np.where(short, one, size)
        by_z, by_v = at_most(z - shift, SETTLED), at_most(v + shift, SETTLED)
        a = one_minus_exp(by_z)
        zg = np.where(s == 0, a, z * np.where(short, one, mean))
        e_v, less = exp_minus(by_v), one_minus_exp(by_v)
        grown = one / e_v
        rho = (zg - a) + zg * np.where(v > 0, less * grown, -less)

        total, rises_far = one + rho, rho < np.float32(-0.5)
        u = np.where(rises_far, exp_minus(by_z) + zg * np.where(v > 0, grown, e_v), total)
        lost = np.where(rises_far, zero, rho - (total - one)) / u
        y1 = (y0 - (natural_log(u) + lost)) + (shift - over)
    return np.where(z > 0, y1, y0)


def at_most(value: F32, limit: np.float32) -> F32:
    """The smaller of |value| and the limit; a NaN counts as the limit."""
    return np.where(np.abs(value) < limit, np.abs(value), limit)


def large_signal_rate(z: F32, y0: F32, x0: F32) -> F32:
    """The rate at which the large-signal photoreceptor approaches its light at first."""
    one = np.float32(1)
    with np.errstate(all="ignore"):
        z = at_most(np.where(np.abs(z) < SLOWEST, np.float32(0), z), FOR_EVER)
        d = x0 - y0
        size = at_most(d, SETTLED)
        near = size < np.float32(2.0**-12)
        into_light = one_minus_exp(size) / np.where(near, one, size)
        share = np.where(d < 0, into_light / exp_minus(size), into_light)
        return at_most(np.where(near, z, z * share), FOR_EVER)


def apart_from(k: F32, z: np.float32) -> F32:
    """The rate of a photoreceptor, not too near that of the follower, nor 0."""
    near = np.abs(k - z) < z * np.float32(2.0**-8)
    rate = np.where(near, z * np.float32(1 + 2.0**-8), k)
    return np.where(rate > STRAIGHT, rate, STRAIGHT)


def follower_lag(k: F32, z: np.float32) -> F32:
    """By how much the follower falls short of its step for a line, of a bend of 1."""
    a, b = shares(k)
    a2, b2 = (share[0] for share in shares(np.array([z])))
    with np.errstate(under="ignore"):
        lag: F32 = k * (b2 * a - a2 * b) / (a * (z - k))
    return lag


def follow(z: F32, y: F32, x0: F32, x1: F32, law: str, short_of: F32 | None = None) -> F32:
    """The filter's next value: from y, while its input goes from x0 to x1 in a line.

    Where the input is no line, a linear pole falls short of the step for a line.
    """
    with np.errstate(under="ignore"):
        if law == "euler":
            out = y + np.where(z < np.float32(1), z, np.float32(1)) * (x1 - y)
        elif law == "large_signal":
            out = large_signal(z, y, x0, x1)
        else:
            a, b = shares(z)
            moves = a * (x0 - y) + b * (x1 - x0)
            out = y + (moves if short_of is None else moves - short_of)
    return np.where(np.abs(out) < FADED, np.float32(0), out)


def _horner(x: F32, coefficients: list[float]) -> F32:
    """The polynomial with these coefficients, the highest first."""
    out = np.full_like(x, coefficients[0])
    for coefficient in coefficients[1:]:
        out = out * x + np.float32(coefficient)
    return out
