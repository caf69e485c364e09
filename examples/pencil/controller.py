"""The controller: observations in, forces out.

An Observation holds the packets of the cameras and the encoders of the motors, never the state of
the simulator. The same object arrives over the network, in a process without a simulator.
"""

from __future__ import annotations

from typing import Protocol

from evs.examples.pencil.balance import StickBalancer, StickGains
from evs.examples.pencil.line_tracker import F64, EventLineTracker, FrameLineTracker, StickLine
from evs.examples.pencil.stereo import DISTANCE_M, FOCAL_PX, Stick, combine, project
from evs.msgs import Observation

CAMERAS = ("left", "right")


class Tracker(Protocol):
    """Estimates the stick from observations."""

    stick: Stick | None
    """the last estimate"""

    def update(self, observation: Observation) -> tuple[Stick, int] | None:
        """The stick and the time of the estimate, us; None: there is no new estimate."""


class EventTracker:
    """A line for each camera that follows its events, up to date at every decision."""

    def __init__(self, length_m: float) -> None:
        """Begin with an upright stick.

        Args:
            length_m: of the stick.
        """
        height_px = length_m * FOCAL_PX / DISTANCE_M
        self._lines = {camera: EventLineTracker(height_px) for camera in CAMERAS}
        self._seen = dict.fromkeys(CAMERAS, StickLine(0.0, 0.0))
        self.stick: Stick | None = None

    def update(self, observation: Observation) -> tuple[Stick, int]:
        """Update both lines. Without events the stick has not moved."""
        cups = dict(zip(CAMERAS, project(observation.position), strict=True))
        for packet in observation.packets:
            camera = packet.camera
            self._seen[camera] = self._lines[camera].update(packet.events, cups[camera])
        self.stick = combine(*(self._seen[camera] for camera in CAMERAS))
        return self.stick, observation.t_us


class FrameTracker:
    """A line for each camera and frame; between frames there is no estimate."""

    def __init__(self) -> None:
        self._fits: dict[tuple[int, int], FrameLineTracker] = {}
        self._lines: dict[str, StickLine] = {}
        self.stick: Stick | None = None

    def update(self, observation: Observation) -> tuple[Stick, int] | None:
        """Fit a line to each new frame. Both cameras expose at once; the middle is the time."""
        stamp_us = 0
        for frame in observation.frames:
            size = frame.width, frame.height
            fit = self._fits.setdefault(size, FrameLineTracker(*size))
            line = fit.update(frame.pixels)
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
    """A new tracker.

    Args:
        fps: frames per second, 0: events.
        length_m: of the stick.
    """
    return FrameTracker() if fps else EventTracker(length_m)


class Controller:
    """A tracker and a balancer."""

    def __init__(
        self, tracker: Tracker, length_m: float = 0.2, gains: StickGains | None = None
    ) -> None:
        """Join a tracker and a balancer.

        Args:
            tracker: estimates the stick.
            length_m: of the stick, which the linear model needs.
            gains: of the balancer.
        """
        self.tracker = tracker
        self.balancer = StickBalancer(length_m, gains)

    def decide(self, observation: Observation) -> F64:
        """(2,) N, for the next tick."""
        found = self.tracker.update(observation)
        if found is None:
            return self.balancer.decide(
                observation.t_us, observation.position, observation.velocity
            )
        stick, stamp_us = found
        return self.balancer.decide(
            observation.t_us, observation.position, observation.velocity, stick.tilt, stamp_us
        )
