"""The signal of a pixel inside a tick: core/sensor/response.h."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.sensor.reference.filters import SETTLED, STRAIGHT, at_most, one_minus_exp

HALLEY, MOST = 6, 40
"""steps of Halley's method, and of all"""


def _share(rate: float, u: float) -> float:
    """1 - e^-(rate u)."""
    z = np.array([np.float32(rate) * np.float32(u)])
    return float(one_minus_exp(at_most(z, SETTLED))[0])


@dataclass(frozen=True)
class Response:
    """What the signal moves by against the reference, log units, over the share u of a tick.

    y(u) = slope u + first (1 - e^-ku) + second (1 - e^-zu), or a line up to `end`.
    """

    end: float
    slope: float = 0.0
    first: float = 0.0
    second: float = 0.0
    k: float = 0.0
    """rate of the photoreceptor, 1 / tick"""
    z: float = 0.0
    """rate of the follower"""
    settling: float = 0.0
    """sum of the time constants, shares of the tick"""
    bends: bool = False

    def moved(self, u: float) -> float:
        """Up to a share of the tick."""
        if not self.bends or u >= 1.0:
            return self.end * u
        return self._at(u)[0]

    def drifting(self, more: float) -> Response:
        """The same with another drift."""
        return replace(self, end=self.end + more, slope=self.slope + more)

    def straighten(self, tick_us: int) -> Response:
        """A line, if that moves no stamp by more than a quarter of a us."""
        bends = [
            abs(amplitude) * min(0.125 * rate * rate, 1.0)
            for amplitude, rate in ((self.first, self.k), (self.second, self.z))
        ]
        return replace(self, bends=(bends[0] + bends[1]) * tick_us > 0.25 * abs(self.end))

    def _at(self, u: float) -> tuple[float, float, float]:
        """What it has moved by, and its derivatives."""
        a, b = _share(self.k, u), _share(self.z, u)
        fast, slow = self.first * (self.k * (1.0 - a)), self.second * (self.z * (1.0 - b))
        moved = self.slope * u + (self.first * a + self.second * b)
        return moved, self.slope + (fast + slow), -(self.k * fast + self.z * slow)

    def share_at(self, level: float, up: bool, start: float, begin: float, tick_us: int) -> float:
        """The share of the tick, from `start` on, at which it has moved by `level`.

        It has moved by `begin` at `start`.
        """
        sign = 1.0 if up else -1.0
        left, total = sign * (level - begin), sign * (self.end - begin)
        if not left > 0.0:
            return start
        if not left < total:
            return 1.0
        low, high = start, 1.0
        u = start + (1.0 - start) * (left / total)
        if start == 0.0:
            steep = sign * (self.slope + (self.first * self.k + self.second * self.z))
            rest = total - steep
            if rest <= 0.0:
                u = left * total / (steep * (total - left) + left * total)
            else:
                u = 2.0 * left / (steep + math.sqrt(steep * steep + 4.0 * rest * left))
            u = min(u, 1.5 * self.settling)
        for i in range(MOST):
            y, rise, bend = self._at(u)
            beyond, rise = sign * (y - level), sign * rise
            if beyond < 0.0:
                low = u
            else:
                high = u
            curve, square = beyond * (sign * bend), rise * rise
            divisor = 2.0 * square - curve
            after = u - 2.0 * beyond * rise / divisor if divisor else math.nan
            bisects = i >= HALLEY or not low < after < high
            if bisects:
                after = 0.5 * (low + high)
            moves = abs(after - u) * float(tick_us)
            u = after
            if moves < 1.0:
                break
            if not bisects and moves * (curve / square * (curve / square)) < 0.1:
                break
        return u

    def stamp(self, level: float, up: bool, now: int, tick_us: int) -> int:
        """When it has moved by `level`, us, rounded up into [now, tick]; 1 at least."""
        if self.bends:
            share = now / tick_us
            after = self.share_at(level, up, share, self.moved(share), tick_us) * tick_us
        else:
            after = level * float(tick_us) / self.end if self.end else 0.0
        return max(now, min(tick_us, max(1, math.ceil(after))) if after < tick_us else tick_us)


@dataclass(frozen=True)
class Filters:
    """The filters of all pixels in a tick, (h, w) each, by which they respond inside it."""

    light: tuple[F32, F32]
    """log light at the start and the end of the tick"""
    signal: tuple[F32, F32]
    """what the comparators see"""
    photoreceptor: tuple[F32, F32] | None = None
    """its output; None: there is none"""
    rate: F32 | None = None
    """of the photoreceptor, 1 / tick"""
    follower_z: np.float32 | None = None
    """None: there is no follower"""
    euler: bool = False

    def response(self, i: int, drift: float, tick_us: int) -> Response:
        """Of pixel i, against a reference that sinks by `drift`."""
        before, after = (float(of.flat[i]) for of in self.signal)
        moved = after - before
        z = self.follower_z
        found = Response(moved + drift)
        none = self.photoreceptor is None and z is None
        if none or self.euler or tick_us == 1 or moved == 0.0:
            return found
        if z is not None and z <= STRAIGHT:
            return found
        x0, x1 = (float(of.flat[i]) for of in self.light)
        span, entering = x1 - x0, x0
        k = a = b = first = second = settling = 0.0
        if self.photoreceptor is not None:
            assert self.rate is not None
            p0, p1 = (float(of.flat[i]) for of in self.photoreceptor)
            k = float(self.rate.flat[i])
            a = _share(k, 1.0)
            settling = 1.0 / k if k > 0.0 else 0.0
            first = -((span - (p1 - p0)) / a) if a > 0.0 else 0.0
            entering = p0
        if z is not None:
            b, lasts = _share(float(z), 1.0), 1.0 / float(z)
            settling += lasts
            second = (entering - before) - span * lasts
            if self.photoreceptor is not None:
                share = first / (float(z) - k)
                second -= share * k
                first = share * float(z)
        slope = found.end - (first * a + second * b)
        z_of = 0.0 if z is None else float(z)
        bent = Response(found.end, slope, first, second, k, z_of, settling)
        return bent.straighten(tick_us)
