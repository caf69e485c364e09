"""Live pictures of a stream: windows of events, for Rerun, Foxglove and a terminal."""

from evs.drivers.viewer.foxglove_sink import FoxgloveSink
from evs.drivers.viewer.sink import ViewSink
from evs.drivers.viewer.sketch import sketch
from evs.drivers.viewer.windows import PERIOD_US, Window, WindowBuilder

__all__ = ["PERIOD_US", "FoxgloveSink", "ViewSink", "Window", "WindowBuilder", "sketch"]
"""Rerun (viewer.py) needs the extra `view`, Foxglove (panels.py) `foxglove`; imported when used."""
