"""The comparators of one pixel through one tick: the contract of core/sensor/comparator.h.

Told as a sequence of happenings: what comes next, a level, noise, or the end of blindness?
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from evs.msgs import Cause
from reference.pixel.noise import ROW_READ, Candidate, on_grid
from reference.pixel.response import Response


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
    bent: Response | None = None
    """how the signal moves inside the tick; None: in a line"""

    @property
    def response(self) -> Response:
        """How the signal moves against the reference."""
        return self.bent or Response((self.signal_end - self.signal) + self.drift)


def compare(p: PixelTick) -> tuple[list[PixelEvent], float, int]:
    """The events in order; the reference at the end of the tick; until when the pixel is blind.

    References are given as they would have been at the start of the tick: then the levels stand
    still, and the signal moves by what it moves against the reference.
    """
    span, response = p.signal_end - p.signal, p.response
    moving = Cause.SIGNAL if abs(p.drift) <= abs(span) else Cause.HOT if p.hot else Cause.LEAK
    events: list[PixelEvent] = []
    shots = list(p.shots)
    now, reference = 0, p.reference
    wake = p.blind_until_us - p.begin_us if math.isnan(reference) else None

    def signal_at(offset_us: int) -> float:
        return float(on_grid(p.signal + response.moved(offset_us / p.tick_us)))

    while True:
        # blind until `wake`, and then the reference is the signal
        if wake is not None:
            if wake > p.tick_us:
                return events, math.nan, p.begin_us + wake
            now, reference, wake = wake, signal_at(wake), None
            shots = [shot for shot in shots if shot.offset_us >= now]

        # what comes next; of two at the same us the level
        level, polarity, reached = _next_level(p, reference, now)
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


def _next_level(p: PixelTick, reference: float, now: int) -> tuple[float | None, int, float]:
    """The next level that the signal reaches, its polarity, and when; None and inf if none."""
    end = p.signal_end + p.drift
    if reference + p.on <= end:
        level, polarity = reference + p.on, 1
    elif reference - p.off >= end:
        level, polarity = reference - p.off, 0
    else:
        return None, 0, math.inf
    return level, polarity, p.response.stamp(level - p.signal, polarity == 1, now, p.tick_us)


def _fires(p: PixelTick, shot: Candidate, above: float) -> bool:
    """Whether a candidate fires a pixel whose signal is so far above its reference, log units."""
    if shot.lot_hz == ROW_READ:
        return above + p.crosstalk >= p.on
    return shot.lot_hz < p.shot_hz
