"""Counter-based random numbers: a number follows from (seed, term, pixel) and from nothing else.

Same bits on every machine: integers, + - * / and sqrt only. NumPy's own log and cos differ in the
last bit between instruction sets, so the two series below stand in for them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum

import numpy as np
import numpy.typing as npt

_LN2 = 0.6931471805599453
_PIXELS_AT_ONCE = 8192
"""64 kB a temporary array"""

F64 = npt.NDArray[np.float64]
U64 = npt.NDArray[np.uint64]


class Term(IntEnum):
    """What a random number is for. A number never changes its meaning."""

    THRESHOLD_OFF = 0
    THRESHOLD_ON = 1
    LEAK_RATE = 2
    LEAK_PHASE = 3
    SHOT_RATE = 4
    DEFECT = 5
    SHOT = 6
    """in core/sensor/shot_noise.h, of blocks of pixels"""
    INTERNAL_STATE = 7
    """of a network: V(0)"""
    REFRACTORY = 8
    HOT_LEAK = 9
    PHOTON_NOISE = 10
    """in core/sensor/photon_noise.h, of a pixel, by the times of its events"""
    LATENCY = 64
    """in core/sensor/readout.h, of an event: pixel, time and polarity"""
    ARBITER = 65
    """in core/sensor/arbiter.h, of a row access"""
    COLUMNS = 66
    """the same: the side from which the columns of the row are sent"""
    PHASE = 67
    """in core/sensor/readout.h, of an event: pixel, time and polarity"""
    APS_SHOT = 32
    APS_READ = 33
    ACCELEROMETER_NOISE = 34
    ACCELEROMETER_WALK = 35
    GYROSCOPE_NOISE = 36
    GYROSCOPE_WALK = 37
    TRANSPORT = 128
    """of a message on its way from a camera"""
    DROP = 129
    CONTROL = 130
    """of a control on its way to the actuators"""


def pixel_normals(seed: int, term: Term, width: int, height: int) -> F64:
    """One standard normal number per pixel, (height, width) float64.

    A pixel's number does not depend on the size of the sensor. Seeds count modulo 2^64.
    """
    return _by_rows(lambda rows: _normals(*_pixel_bits(seed, term, width, rows)), width, height)


def pixel_uniforms(seed: int, term: Term, width: int, height: int) -> F64:
    """One number of [0, 1) per pixel, (height, width) float64, as pixel_normals."""
    return _by_rows(lambda rows: _uniform(_pixel_bits(seed, term, width, rows)[0]), width, height)


def indexed_normals(
    seed: int, term: npt.ArrayLike, index: npt.ArrayLike, counter: npt.ArrayLike
) -> F64:
    """One standard normal number for each (term, index, counter), which broadcast.

    Terms are of Term; index counts frames or samples, counter (< 2^63) pixels or axes.
    """
    places = np.atleast_1d(np.asarray(index, np.int64)).astype(np.uint64)
    key = _hash(_key(seed, term), places + np.uint64(1))
    doubled = np.asarray(counter, np.uint64) << np.uint64(1)
    return _normals(_hash(key, doubled + np.uint64(1)), _hash(key, doubled + np.uint64(2)))


def indexed_uniforms(
    seed: int, term: npt.ArrayLike, index: npt.ArrayLike, counter: npt.ArrayLike
) -> F64:
    """One number of [0, 1) for each (term, index, counter), as indexed_normals."""
    places = np.atleast_1d(np.asarray(index, np.int64)).astype(np.uint64)
    key = _hash(_key(seed, term), places + np.uint64(1))
    return _uniform(_hash(key, np.asarray(counter, np.uint64) + np.uint64(1)))


def _normals(first: U64, second: U64) -> F64:
    """Box and Muller 1958; the first uniform is in (0, 1], the second in [0, 1)."""
    log = _log(_uniform(first) + 2.0**-53)
    radius = np.sqrt(-2.0 * np.minimum(log, 0.0))  # rounding may leave a log of 1e-17
    return np.asarray(radius * _cos_turn(_uniform(second)))


def _key(seed: int, term: npt.ArrayLike) -> U64:
    number = np.atleast_1d(np.asarray(term, np.uint64))
    return _hash(np.array([seed % 2**64], np.uint64), number + np.uint64(1))


def _by_rows(draw: Callable[[range], F64], width: int, height: int) -> F64:
    """(height, width) of some rows at a time: what lies between stays in the cache."""
    out = np.empty((height, width))
    step = max(1, _PIXELS_AT_ONCE // width)
    for first in range(0, height, step):
        rows = range(first, min(first + step, height))
        out[rows.start : rows.stop] = draw(rows)
    return out


def _pixel_bits(seed: int, term: Term, width: int, rows: range) -> tuple[U64, U64]:
    lines = np.arange(rows.start, rows.stop, dtype=np.uint64)[:, np.newaxis]
    columns = np.arange(width, dtype=np.uint64)[np.newaxis, :]
    counter = (lines << np.uint64(32)) | (columns << np.uint64(1))
    key = _key(seed, term)
    return _hash(key, counter + np.uint64(1)), _hash(key, counter + np.uint64(2))


def exp10(value: F64) -> F64:
    """10^value for |value| < 100 by the series of exp; error below 1e-14."""
    scaled = value * math.log2(10.0)
    whole = np.round(scaled)
    rest = (scaled - whole) * _LN2
    series = np.ones_like(rest)
    for order in range(16, 0, -1):
        series = 1.0 + series * rest / order
    return np.ldexp(series, whole.astype(np.int64))


def _uniform(bits: U64) -> F64:
    """53 of the bits as a number in [0, 1)."""
    return (bits >> np.uint64(11)).astype(np.float64) * np.float64(2.0**-53)


def _hash(key: U64, counter: U64) -> U64:
    """64 mixed bits: a step of the SplitMix64 generator (Steele, Lea, Flood 2014), twice."""
    mixed = key + counter * np.uint64(0x9E3779B97F4A7C15)
    for _ in range(2):
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed = mixed ^ (mixed >> np.uint64(31))
    return mixed


def _log(value: F64) -> F64:
    """Natural logarithm by the series of artanh; error below 1e-15 for values in [2^-53, 1]."""
    mantissa, exponent = np.frexp(value)  # mantissa in [1/2, 1)
    z = (mantissa - math.sqrt(0.5)) / (mantissa + math.sqrt(0.5))  # |z| < 0.172
    square = z * z
    series = np.zeros_like(z)
    for odd in range(21, 0, -2):
        series = series * square + 1.0 / odd
    return np.asarray(2.0 * z * series + (exponent - 0.5) * _LN2)


def _cos_turn(turn: F64) -> F64:
    """cos(2 pi turn) for turn in [0, 1) by its Taylor series; error below 1e-12."""
    # fold into [0, 1/4] of a turn, where the series needs few terms
    half = np.abs(turn - 0.5)  # cos(2 pi turn) = -cos(2 pi half), half in [0, 1/2]
    folded = np.minimum(half, 0.5 - half)
    square = np.square(2.0 * math.pi * folded)
    series = np.zeros_like(square)
    for order in range(18, 0, -2):
        series = (series + 1.0) * (-square / (order * (order - 1)))
    return np.where(half <= 0.25, -1.0, 1.0) * (series + 1.0)
