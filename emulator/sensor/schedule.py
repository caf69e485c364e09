"""What happens n / rate_hz after the clock's zero, in whole microseconds: frames and samples."""

from __future__ import annotations

import math


def stamp_us(index: int, rate_hz: float) -> int:
    """When number `index` is due, us: the nearest whole one, so that no error accumulates."""
    return math.floor(index * 1e6 / rate_hz + 0.5)


def first_from(t_us: int, rate_hz: float) -> int:
    """The lowest number that is due at or after `t_us`."""
    index = math.floor(t_us * rate_hz / 1e6)
    while stamp_us(index, rate_hz) < t_us:
        index += 1
    while stamp_us(index - 1, rate_hz) >= t_us:
        index -= 1
    return index
