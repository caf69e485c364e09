"""ViewSink: a run as a .rrd file that Rerun's viewer opens (extra `view`)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evs.drivers.sink import Sink, SinkStoppedError, Stream
from evs.drivers.viewer.windows import PERIOD_US, WindowBuilder
from evs.msgs import EventPacket, EvsError, Frame, StreamInfo, unknown

if TYPE_CHECKING:
    from evs.drivers.viewer.viewer import Drawing
    from evs.emulator.base.scene import F32
    from evs.msgs import Pose

SUFFIX = ".rrd"


class ViewSink(Sink):
    """A Sink of any number of cameras: events, rates, luminance, frames and poses over time.

    One picture of each per `period_us` of simulated time; between two of them a tick costs only the
    gathering of its events. A full disk stops it with SinkStoppedError.
    """

    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.LIGHT, Stream.POSE})

    def __init__(self, file: str | Path, *, period_us: int = PERIOD_US) -> None:
        """Make a sink that is not open yet.

        Args:
            file: Ending in .rrd; replaced at open.
            period_us: Simulated time from one picture to the next, us.

        Raises:
            EvsError: The extra is not installed, another ending.
        """
        from evs.drivers.viewer.viewer import need_viewer

        self._path = Path(file)
        if self._path.suffix != SUFFIX:
            raise EvsError(f"'{self._path}' does not end in {SUFFIX}, as Rerun's recordings do")
        if period_us < 1:
            raise EvsError(f"period_us is {period_us}: give the us of a picture, 1 or more")
        need_viewer()
        self._period_us = period_us
        self._drawing: Drawing | None = None
        self._builders: dict[str, WindowBuilder] = {}
        self._due_us: dict[tuple[str, str], int] = {}
        self._white: dict[str, float] = {}
        self._counts: dict[str, Any] = {"windows": 0, "events": 0, "frames": 0, "error": ""}

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Create the file. EvsError: it cannot be created."""
        from evs.drivers.viewer.viewer import Drawing

        self._drawing = Drawing()
        self._drawing.to_file(self._path)
        self._drawing.describe(list(streams))
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
        for window in builder.add(packet):
            drawing.window(window)
            self._counts["windows"] += 1
        self._counts["events"] += len(packet)

    def write_frame(self, frame: Frame) -> None:
        """Draw one intensity frame."""
        self._opened().frame(frame)
        self._counts["frames"] += 1

    def wants_light(self, camera: str, t_us: int) -> bool:
        """Return whether a picture of the light is due."""
        return self._is_due("luminance", camera, t_us)

    def write_light(self, camera: str, t_us: int, luminance: F32) -> None:
        """Draw the light; the brightest seen so far of the camera is white, and 0 is black."""
        white = max(self._white.get(camera, 0.0), float(np.nanmax(luminance, initial=0.0)))
        self._white[camera] = white
        # the square root is how pictures are coded, nearly
        share = np.sqrt(np.clip(np.nan_to_num(luminance) / (white or 1.0), 0.0, 1.0))
        picture = np.rint(255.0 * share).astype(np.uint8)
        self._opened().luminance(camera, t_us, picture)

    def wants_pose(self, camera: str) -> bool:
        """Return True for a camera of this view; `write_pose` draws a pose only when one is due."""
        return camera in self._builders

    def write_pose(self, pose: Pose) -> None:
        """Draw the camera's pose, if one is due."""
        if self._is_due("pose", pose.camera, pose.t_us):
            self._opened().pose(pose.camera, pose.t_us, pose.position, pose.orientation)

    def close(self) -> dict[str, Any]:
        """Draw what is left and end the file. Safe to call twice."""
        if self._drawing is not None:
            for builder in self._builders.values():
                for window in builder.rest():
                    self._drawing.window(window)
                    self._counts["windows"] += 1
            self._drawing.close()
            self._counts["error"] = self._failure(self._drawing)
            self._drawing = None
        return {"type": "rerun", "path": str(self._path), **self._counts}

    def _is_due(self, what: str, camera: str, t_us: int) -> bool:
        due_us = self._due_us.get((what, camera), t_us)
        if t_us < due_us:
            return False
        self._due_us[what, camera] = t_us - t_us % self._period_us + self._period_us
        return True

    def _opened(self) -> Drawing:
        if self._drawing is None:
            raise EvsError("this view is not open: call open(streams) first")
        if self._drawing.failure:
            raise SinkStoppedError(self._failure(self._drawing))
        return self._drawing

    def _failure(self, drawing: Drawing) -> str:
        if not drawing.failure:
            return ""
        return (
            f"writing {self._path} stopped: {drawing.failure}; Rerun shows what came before, free "
            "some space and run again"
        )
