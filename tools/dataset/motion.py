"""Motion: controls of a scene's actuators, as smooth curves through a few points in time.

They depend on time and seed alone, so any range of a scene can be made on its own.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.world import ControlFunction, MjModel, actuator_names
from evs.msgs import EvsError, unknown

Point = tuple[float, float]


@dataclass(frozen=True)
class Track:
    """[[motion]]: the control of one actuator of the scene."""

    actuator: str = ""
    """name"""
    at: tuple[Point, ...] = ((0.0, 0.0),)
    """(t s, control): a smooth curve through these points, constant before and after them"""
    period_s: float = 0.0
    """over 0: period after which the curve repeats, smoothly"""
    shake: float = 0.0
    """amplitude of a smooth random signal that is added, like that of a hand-held camera"""
    shake_hz: float = 2.0
    """how often that signal has a new target"""


def control_of(tracks: Sequence[Track], model: MjModel, seed: int) -> ControlFunction:
    """The control function of all tracks; the control of actuators without one is 0.

    Args:
        tracks: of the actuators.
        model: the scene's model.
        seed: of the shake.

    Raises:
        EvsError: a track makes no curve; the message says which.
    """
    names = actuator_names(model)
    curves: dict[int, Callable[[float], float]] = {}
    for place, track in enumerate(tracks):
        if track.actuator not in names:
            wrong = unknown("actuator", track.actuator, names)
            raise EvsError(f"at motion.{place}.actuator: {wrong}")
        index = names.index(track.actuator)
        if index in curves:
            raise EvsError(f"at motion.{place}.actuator: '{track.actuator}' has two tracks")
        _check(track, place)
        curves[index] = _curve(track, seed, index)

    def control(t_s: float, _data: object) -> F64:
        values = np.zeros(len(names))
        for index, curve in curves.items():
            values[index] = curve(t_s)
        return values

    return control


def _check(track: Track, place: int) -> None:
    """Raise an EvsError if a track makes no curve."""
    times = [t_s for t_s, _ in track.at]
    numbers = [*times, *(value for _, value in track.at), track.shake, track.shake_hz]
    if not times or any(b <= a for a, b in pairwise(times)):
        raise EvsError(f"at motion.{place}.at: give points (t, value) with t growing")
    if not all(map(math.isfinite, numbers)) or not track.shake_hz > 0:
        raise EvsError(f"at motion.{place}: every number has to be finite, shake_hz over 0")
    if track.period_s and not (times[0] >= 0 and track.period_s > times[-1]):
        raise EvsError(f"at motion.{place}.period_s: it has to be longer than the points of `at`")


def _curve(track: Track, seed: int, index: int) -> Callable[[float], float]:
    points, period_s = list(track.at), track.period_s
    if period_s and len(points) > 1:
        # two points of the periods before and after, so that the seam is smooth too
        before = [(t_s - period_s, value) for t_s, value in points[-2:]]
        after = [(t_s + period_s, value) for t_s, value in points[:2]]
        points = [*before, *points, *after]
    times = [t_s for t_s, _ in points]
    slopes = _slopes(points)

    def curve(t_s: float) -> float:
        at_s = t_s % period_s if period_s else t_s
        value = _hermite(points, slopes, times, at_s)
        if track.shake:
            value += track.shake * _wander(seed, index, t_s * track.shake_hz)
        return value

    return curve


def _slopes(points: Sequence[Point]) -> list[float]:
    """Slopes of a Catmull-Rom spline, those of the chords; an end has one neighbour only."""
    last = len(points) - 1
    found = []
    for place in range(len(points)):
        (t0, v0), (t1, v1) = points[max(0, place - 1)], points[min(last, place + 1)]
        found.append((v1 - v0) / (t1 - t0) if t1 > t0 else 0.0)
    return found


def _hermite(
    points: Sequence[Point], slopes: Sequence[float], times: Sequence[float], t_s: float
) -> float:
    """The cubic through the two points around t_s."""
    place = bisect_right(times, t_s) - 1
    if place < 0 or place >= len(points) - 1:
        return points[0 if place < 0 else -1][1]
    (t0, v0), (t1, v1) = points[place], points[place + 1]
    width = t1 - t0
    u = (t_s - t0) / width
    rest = 1.0 - u
    return (
        v0 * rest * rest * (1.0 + 2.0 * u)
        + v1 * u * u * (3.0 - 2.0 * u)
        + width * u * rest * (slopes[place] * rest - slopes[place + 1] * u)
    )


def _wander(seed: int, index: int, phase: float) -> float:
    """A smooth random signal in -1 ... 1 between random targets; 0 at the start."""
    knot = math.floor(phase)
    u = phase - knot
    u = u * u * (3.0 - 2.0 * u)
    here, there = _target(seed, index, knot), _target(seed, index, knot + 1)
    return here + (there - here) * u


def _target(seed: int, index: int, knot: int) -> float:
    if knot <= 0:
        return 0.0
    mask = (1 << 64) - 1
    bits = np.random.Philox(key=(seed & mask) ^ (index << 40), counter=knot << 64)
    return float(bits.random_raw()) / 2.0**63 - 1.0
