"""The whole controller: what arrives goes in, forces come out. It knows nothing else.

An Observation holds what the cameras sent and what the motors' encoders say, never the simulator's
state; the same object arrives over the wire, in a process that has no simulator.
"""

from __future__ import annotations

from typing import Protocol

from evs.examples.pencil.balance import Balancer, Gains
from evs.examples.pencil.line import F64, EventLine, FrameLine, Line
from evs.examples.pencil.views import DISTANCE_M, FOCAL_PX, Stick, combine, project
from evs.msgs import Observation

CAMERAS = ("left", "right")


class Tracker(Protocol):
    """Eyes: what arrived into the stick, and the time that it is of."""

    stick: Stick | None
    """the last one that was seen"""

    def look(self, seen: Observation) -> tuple[Stick, int] | None:
        """The stick and the time it was there, us; None: nothing new."""


class EventTracker:
    """A line per camera that follows its events, up to date at every decision."""

    def __init__(self, length_m: float) -> None:
        """In: length_m, of the stick."""
        height_px = length_m * FOCAL_PX / DISTANCE_M
        self._lines = {camera: EventLine(height_px) for camera in CAMERAS}
        self._seen = dict.fromkeys(CAMERAS, Line(0.0, 0.0))
        self.stick: Stick | None = None

    def look(self, seen: Observation) -> tuple[Stick, int]:
        """That no event came tells something, too: the stick is where it was."""
        cups = dict(zip(CAMERAS, project(seen.position), strict=True))
        for packet in seen.packets:
            camera = packet.camera
            self._seen[camera] = self._lines[camera].see(packet.events, cups[camera])
        self.stick = combine(*(self._seen[camera] for camera in CAMERAS))
        return self.stick, seen.t_us


class FrameTracker:
    """A line per camera and frame; between frames nothing is known."""

    def __init__(self) -> None:
        self._fits: dict[tuple[int, int], FrameLine] = {}
        self._lines: dict[str, Line] = {}
        self.stick: Stick | None = None

    def look(self, seen: Observation) -> tuple[Stick, int] | None:
        """A frame is of the middle of its exposure, and both cameras expose at once."""
        stamp_us = 0
        for frame in seen.frames:
            size = frame.width, frame.height
            fit = self._fits.setdefault(size, FrameLine(*size))
            line = fit.see(frame.pixels)
            if line is None:
                self._lines.pop(frame.camera, None)
                continue
            self._lines[frame.camera] = line
            stamp_us = (frame.exposure_begin_us + frame.exposure_end_us) // 2
        if not stamp_us or len(self._lines) < len(CAMERAS):
            return None
        self.stick = combine(*(self._lines[camera] for camera in CAMERAS))
        return self.stick, stamp_us


def make_tracker(fps: int, length_m: float) -> Tracker:
    """New eyes. In: fps, frames per second, 0: events; length_m, of the stick."""
    return FrameTracker() if fps else EventTracker(length_m)


class Controller:
    """Eyes, an observer and forces."""

    def __init__(self, tracker: Tracker, length_m: float = 0.2, gains: Gains | None = None) -> None:
        """In: length_m, of the stick: the model needs it."""
        self.tracker = tracker
        self.balancer = Balancer(length_m, gains)

    def decide(self, seen: Observation) -> F64:
        """(2,) N, for the next tick."""
        found = self.tracker.look(seen)
        if found is None:
            return self.balancer.decide(seen.t_us, seen.position, seen.velocity)
        stick, stamp_us = found
        return self.balancer.decide(seen.t_us, seen.position, seen.velocity, stick.tilt, stamp_us)
