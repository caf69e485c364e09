"""ViewSink: a run as a .rrd file that Rerun's viewer opens (extra `view`)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evs.drivers.viewer.picture_sink import PictureSink
from evs.drivers.viewer.time_windows import PERIOD_US
from evs.msgs import EvsError, StreamInfo

if TYPE_CHECKING:
    from evs.drivers.viewer.rerun_drawing import RerunDrawing

SUFFIX = ".rrd"


class ViewSink(PictureSink):
    """A PictureSink that writes a .rrd file."""

    def __init__(self, file: str | Path, *, period_us: int = PERIOD_US, points: int = 0) -> None:
        """Make a sink that is not open yet.

        Args:
            file: Ending in .rrd; replaced at open.
            period_us: Simulated time from one picture to the next, us.
            points: Most points of each picture's cloud of events in x, y and time; 0: no cloud.

        Raises:
            EvsError: The extra is not installed, another ending.
        """
        from evs.drivers.viewer.rerun_drawing import RerunDrawing

        self._path = Path(file)
        if self._path.suffix != SUFFIX:
            raise EvsError(f"'{self._path}' does not end in {SUFFIX}, as Rerun's recordings do")
        super().__init__(period_us)
        self._rerun = RerunDrawing(points)

    def close(self) -> dict[str, Any]:
        """Draw what is left and end the file. Safe to call twice."""
        return {"type": "rerun", "path": str(self._path), **super().close()}

    def _begin(self, streams: Sequence[StreamInfo]) -> RerunDrawing:
        self._rerun.to_file(self._path)
        self._rerun.describe(list(streams))
        return self._rerun

    def _stopped(self, failure: str) -> str:
        return (
            f"writing {self._path} stopped: {failure}; Rerun shows what came before, free some "
            "space and run again"
        )
