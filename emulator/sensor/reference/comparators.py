"""The comparators of one pixel through one tick: the contract of core/sensor/comparator.h.

Told as a sequence of happenings: what comes next, a level, noise, or the end of blindness?
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from evs.emulator.sensor.reference.noise import ROW_READ, Candidate, on_grid
from evs.msgs import Cause


@dataclass(frozen=True)
class PixelEvent:
    """An event of the pixel."""

    offset_us: int
    """after the start of the tick, 1 ... tick"""
    polarity: int
    """1 ON, 0 OFF"""
    cause: Cause


@dataclass(frozen=True)
class PixelTick:
    """A pixel and what a tick brings it. Log units, us; the pixel has seen light before."""

    on: float
    off: float
    reference: float
    """at the start of the tick; NaN: blind"""
    blind_until_us: int
    """by the sensor's clock, of a blind pixel"""
    signal: float
    """at the start of the tick"""
    signal_end: float
    """at its end"""
    drift: float
    """by how much the reference sinks in the tick"""
    begin_us: int
    """the tick's start by the sensor's clock"""
    tick_us: int
    refractory_us: int = 0
    hot: bool = False
    shots: tuple[Candidate, ...] = ()
    shot_on_hz: float = 0.0
    """rate of ON noise at this light"""
    shot_hz: float = 0.0
    """rate of both"""
    crosstalk: float = 0.0
    """by how much the read of its row lifts the signal for an instant"""


def compare(p: PixelTick) -> tuple[list[PixelEvent], float, int]:
    """The events in order; the reference at the end of the tick; until when the pixel is blind.

    References are given as they would have been at the start of the tick: then the levels stand
    still, and the signal moves by `speed` in the tick.
    """
    span = p.signal_end - p.signal
    speed = span + p.drift
    end = p.signal_end + p.drift
    moving = Cause.SIGNAL if abs(p.drift) <= abs(span) else Cause.HOT if p.hot else Cause.LEAK
    events: list[PixelEvent] = []
    shots = list(p.shots)
    now, reference = 0, p.reference
    wake = p.blind_until_us - p.begin_us if math.isnan(reference) else None

    def signal_at(offset_us: int) -> float:
        return float(on_grid(p.signal + speed * (offset_us / p.tick_us)))

    while True:
        # blind until `wake`, and then the reference is the signal
        if wake is not None:
            if wake > p.tick_us:
                return events, math.nan, p.begin_us + wake
            now, reference, wake = wake, signal_at(wake), None
            shots = [shot for shot in shots if shot.offset_us >= now]

        # what comes next; of two at the same us the level
        level, polarity = None, 0
        if reference + p.on <= end:
            level, polarity = reference + p.on, 1
        elif reference - p.off >= end:
            level = reference - p.off
        reached = (
            math.inf if level is None else max(now, _stamp(level - p.signal, speed, p.tick_us))
        )
        if level is not None and (not shots or reached <= shots[0].offset_us):
            now, reference, cause = int(reached), level, moving
        elif shots:
            shot = shots.pop(0)
            here = signal_at(shot.offset_us)
            if not _fires(p, shot, here - reference):
                continue
            now, reference, cause = shot.offset_us, here, Cause.SHOT
            polarity = int(shot.lot_hz < p.shot_on_hz)
            if shot.lot_hz == ROW_READ:
                polarity, cause = 1, Cause.APS
        else:
            return events, reference - p.drift, p.blind_until_us
        events.append(PixelEvent(now, polarity, cause))
        if p.refractory_us:
            wake = now + p.refractory_us


def _fires(p: PixelTick, shot: Candidate, above: float) -> bool:
    """Whether a candidate fires a pixel whose signal is so far above its reference, log units."""
    if shot.lot_hz == ROW_READ:
        return above + p.crosstalk >= p.on
    return shot.lot_hz < p.shot_hz


def _stamp(part: float, speed: float, tick_us: int) -> int:
    """When a line that moves `speed` in a tick has moved `part`, us, rounded up into [1, tick]."""
    after = part * float(tick_us) / speed if speed else 0.0
    return min(tick_us, max(1, math.ceil(after))) if after < tick_us else tick_us
