"""Shot noise and leak: the contracts of core/sensor/shot_noise.h, pixel_front_end.h and random.h.

Python's integers and floats, one number at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor.fixed_pattern import FixedPattern
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.random import Term

UNITS = 1024
"""of the clock of shot noise, in a us"""
ROW_READ = -1.0
"""the lot of a candidate that is the read of the pixel's row in an intensity frame"""
NEVER = 2**62
"""what that clock shows where no candidate comes any more"""


@dataclass(frozen=True)
class Candidate:
    """A place and a time at which shot noise may come."""

    pixel: int
    """in its block"""
    offset_us: int
    """after the start of the tick, 1 ... tick"""
    lot_hz: float
    """it comes where the pixel's rate is over this"""


def candidates(
    seed: int,
    block: int,
    pixels: int,
    most_hz: float,
    clock: tuple[int, int],
    begin_us: int,
    end_us: int,
) -> tuple[list[Candidate], tuple[int, int]]:
    """Candidates of a block in (begin_us, end_us] of the sensor's clock, and its clock after them.

    Args:
        seed: What they follow from.
        block: Number of the block.
        pixels: How many pixels it has.
        most_hz: The highest rate of one of its pixels.
        clock: When the next one comes, 2^-10 us, and how many came.
        begin_us: Where the tick begins.
        end_us: Where it ends.
    """
    key = hash_bits(hash_bits(seed % 2**64, Term.SHOT + 1), block + 1)
    mean_gap = 1e6 * UNITS / (most_hz * pixels) if most_hz > 0.0 else math.inf
    following, count = clock
    found = []
    while following <= end_us * UNITS:
        # number 0 is no candidate: it is where the clock starts
        if count > 0:
            bits = hash_bits(key, 2 * count + 2)
            pixel = (bits >> 32) * pixels >> 32
            lot_hz = bits % 2**32 * 2.0**-32 * most_hz
            offset_us = -(-following // UNITS) - begin_us
            found.append(Candidate(pixel, offset_us, lot_hz))
        gap = exponential(hash_bits(key, 2 * count + 1)) * mean_gap
        following = following + math.ceil(gap) if gap < 2.0**61 else NEVER
        count += 1
    return found, (following, count)


def most_shot_hz(pattern: FixedPattern, block: slice) -> float:
    """The highest rate of both polarities of a pixel of a block."""
    assert pattern.shot_on is not None
    assert pattern.shot_off is not None
    on, off = (part.reshape(-1)[block] for part in (pattern.shot_on, pattern.shot_off))
    return float(np.max(on.astype(np.float64) + off.astype(np.float64)))


def shot_share(sensor: SensorParameters, dn: float) -> float:
    """How much of a pixel's rate in the dark is left at this light."""
    bright, dim_dn = sensor.shot_noise_bright, sensor.dim_lux / sensor.lux_per_dn
    if sensor.shot_noise_law == "inverse":
        return bright + (1.0 - bright) * (dim_dn / (dim_dn + dn) if dn > 0.0 else 1.0)
    lux = sensor.bright_lux + sensor.dim_lux
    relative = sensor.dim_lux / lux + sensor.lux_per_dn / lux * dn
    return 1.0 - (1.0 - bright) * min(1.0, relative)


def leak(sensor: SensorParameters, pattern: FixedPattern, dn: F32) -> F64:
    """Log units (h, w) by which references sink in a us at this light, multiples of 2^-43.

    What light brings is at most a threshold a us.
    """
    if pattern.leak is None:
        return np.zeros(dn.shape)
    dark = pattern.leak.astype(np.float64)
    if pattern.parasitic is None:
        return dark
    with np.errstate(invalid="ignore"):  # pixels without light
        more = pattern.parasitic * (sensor.lux_per_dn / sensor.bright_lux * dn.astype(np.float64))
        more = np.minimum(more, pattern.on.astype(np.float64))
        return dark + on_grid(more)


def on_grid(value: npt.ArrayLike) -> F64:
    """The multiples of 2^-43 that are nearest, ties to even: what a sum near 768 leaves of it.

    Farther than 2^8 from 0 the grid is as coarse as that sum.
    """
    return np.asarray((np.asarray(value, np.float64) + 768.0) - 768.0)


def hash_bits(key: int, counter: int) -> int:
    """64 mixed bits: SplitMix64's step (Steele, Lea, Flood 2014), twice."""
    mixed = (key + counter * 0x9E3779B97F4A7C15) % 2**64
    for _ in range(2):
        mixed = (mixed ^ mixed >> 30) * 0xBF58476D1CE4E5B9 % 2**64
        mixed = (mixed ^ mixed >> 27) * 0x94D049BB133111EB % 2**64
        mixed ^= mixed >> 31
    return mixed


def uniform(bits: int) -> float:
    """53 of the bits as a number in [0, 1)."""
    return (bits >> 11) * 2.0**-53


def exponential(bits: int) -> float:
    """-ln of a number in (0, 1]."""
    return max(0.0, -_ln(uniform(bits) + 2.0**-53))


def normal(key: int, counter: int) -> float:
    """A standard normal number from the counters after this one (Box and Muller 1958)."""
    log = _ln(uniform(hash_bits(key, counter + 1)) + 2.0**-53)
    turn = uniform(hash_bits(key, counter + 2))
    # cos(2 pi turn) by its Taylor series
    half = abs(turn - 0.5)
    angle = 2.0 * math.pi * min(half, 0.5 - half)
    series = 0.0
    for order in range(18, 0, -2):
        series = (series + 1.0) * (-(angle * angle) / (order * (order - 1)))
    return math.sqrt(-2.0 * min(log, 0.0)) * ((-1.0 if half <= 0.25 else 1.0) * (series + 1.0))


def _ln(value: float) -> float:
    """By the series of artanh."""
    mantissa, exponent = math.frexp(value)
    z = (mantissa - math.sqrt(0.5)) / (mantissa + math.sqrt(0.5))
    series = 0.0
    for odd in range(21, 0, -2):
        series = series * (z * z) + 1.0 / odd
    return 2.0 * z * series + (exponent - 0.5) * math.log(2.0)
