"""Live pictures of a stream: windows of events, for Rerun, Foxglove and a terminal."""

from evs.drivers.viewer.foxglove_sink import FoxgloveSink
from evs.drivers.viewer.rerun_sink import ViewSink
from evs.drivers.viewer.sketch import sketch
from evs.drivers.viewer.time_windows import PERIOD_US, Window, WindowBuilder

__all__ = ["PERIOD_US", "FoxgloveSink", "ViewSink", "Window", "WindowBuilder", "sketch"]
"""The packages of the extras `view` (Rerun) and `foxglove` are imported when they are used."""
