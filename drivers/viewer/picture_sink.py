"""PictureSink: what the sinks of Rerun and Foxglove share, which is when a picture is due."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from evs.drivers.sink import Sink, SinkStoppedError, Stream
from evs.drivers.viewer.time_windows import WindowBuilder
from evs.msgs import EventPacket, EvsError, Frame, Pose, StreamInfo, unknown
from evs.msgs.pictures import SteadyExposure

if TYPE_CHECKING:
    from evs.drivers.viewer.time_windows import Window
    from evs.emulator.base.scene import F32


class Drawing(Protocol):
    """Where pictures go."""

    @property
    def failure(self) -> str:
        """Why nothing more can be drawn; empty while all is well."""

    def wants(self, stream: Stream, camera: str) -> bool:
        """Return whether a client views a stream of a camera."""

    def events(self, packet: EventPacket) -> None:
        """Take the events themselves, before the windows that they complete."""

    def window(self, window: Window) -> None:
        """Draw events and rates of a window."""

    def frame(self, frame: Frame) -> None:
        """Draw an intensity frame."""

    def luminance(self, camera: str, t_us: int, picture: npt.NDArray[np.uint8]) -> None:
        """Draw the light on the sensor, (h, w), as it is shown."""

    def pose(self, pose: Pose) -> None:
        """Draw the camera's pose in the world."""

    def close(self) -> None:
        """Send everything that waits, and disconnect."""


class PictureSink(Sink):
    """A Sink of any number of cameras: events, rates, luminance, frames and poses over time.

    One picture of each per `period_us` of simulated time; between two of them a tick costs only the
    gathering of its events. A full disk stops it with SinkStoppedError.
    """

    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.LIGHT, Stream.POSE})

    def __init__(self, period_us: int) -> None:
        """Make a sink that is not open yet.

        Args:
            period_us: Simulated time from one picture to the next, us.

        Raises:
            EvsError: No period.
        """
        if period_us < 1:
            raise EvsError(f"period_us is {period_us}: give the us of a picture, 1 or more")
        self._period_us = period_us
        self._drawing: Drawing | None = None
        self._builders: dict[str, WindowBuilder] = {}
        self._due_us: dict[tuple[str, str], int] = {}
        self._exposures: dict[str, SteadyExposure] = {}
        self._counts: dict[str, Any] = {"windows": 0, "events": 0, "frames": 0, "error": ""}

    @abstractmethod
    def _begin(self, streams: Sequence[StreamInfo]) -> Drawing:
        """Create the file or the server."""

    @abstractmethod
    def _stopped(self, failure: str) -> str:
        """One line for the user, from a drawing's failure."""

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the file or the server. EvsError: it cannot be created."""
        self._drawing = self._begin(streams)
        self._builders = {
            one.camera: WindowBuilder(one.camera, one.width, one.height, self._period_us)
            for one in streams
        }

    def write(self, packet: EventPacket) -> None:
        """Add one packet; draw the windows that it completes."""
        drawing = self._opened()
        builder = self._builders.get(packet.camera)
        if builder is None:
            raise unknown("camera of this view", packet.camera, self._builders)
        self._counts["events"] += len(packet)
        drawing.events(packet)
        if not drawing.wants(Stream.EVENTS, packet.camera):
            builder.restart()
            return
        for window in builder.add(packet):
            drawing.window(window)
            self._counts["windows"] += 1

    def write_frame(self, frame: Frame) -> None:
        """Draw one intensity frame."""
        drawing = self._opened()
        if drawing.wants(Stream.FRAMES, frame.camera):
            drawing.frame(frame)
            self._counts["frames"] += 1

    def wants_light(self, camera: str, t_us: int) -> bool:
        """Return whether a picture of the light is due."""
        return self._wants(Stream.LIGHT, camera) and self._is_due("luminance", camera, t_us)

    def write_light(self, camera: str, t_us: int, luminance: F32) -> None:
        """Draw the light, at one exposure for a camera, that of its brightest picture so far."""
        exposure = self._exposures.setdefault(camera, SteadyExposure())
        self._opened().luminance(camera, t_us, exposure.code(luminance))

    def wants_pose(self, camera: str) -> bool:
        """Return True for a camera of this view; `write_pose` draws a pose only when one is due."""
        return camera in self._builders and self._wants(Stream.POSE, camera)

    def write_pose(self, pose: Pose) -> None:
        """Draw the camera's pose, if one is due."""
        if self._is_due("pose", pose.camera, pose.t_us):
            self._opened().pose(pose)

    def close(self) -> dict[str, Any]:
        """Draw what is left and end. Safe to call twice."""
        if self._drawing is not None:
            for builder in self._builders.values():
                for window in builder.rest():
                    self._drawing.window(window)
                    self._counts["windows"] += 1
            drawing, self._drawing = self._drawing, None
            drawing.close()
            if drawing.failure:
                self._counts["error"] = self._stopped(drawing.failure)
        return dict(self._counts)

    def _wants(self, stream: Stream, camera: str) -> bool:
        return self._drawing is not None and self._drawing.wants(stream, camera)

    def _is_due(self, what: str, camera: str, t_us: int) -> bool:
        due_us = self._due_us.get((what, camera), t_us)
        # time may also have been set back, as by a loop's reset
        if due_us - self._period_us <= t_us < due_us:
            return False
        self._due_us[what, camera] = t_us - t_us % self._period_us + self._period_us
        return True

    def _opened(self) -> Drawing:
        if self._drawing is None:
            raise EvsError("this view is not open: call open(streams) first")
        if self._drawing.failure:
            raise SinkStoppedError(self._stopped(self._drawing.failure))
        return self._drawing
