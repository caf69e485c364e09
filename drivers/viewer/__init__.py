"""Live pictures of a stream: windows of events, for Rerun's viewer and for a terminal."""

from evs.drivers.viewer.sink import ViewSink
from evs.drivers.viewer.sketch import sketch
from evs.drivers.viewer.windows import PERIOD_US, Window, WindowBuilder

__all__ = ["PERIOD_US", "ViewSink", "Window", "WindowBuilder", "sketch"]
"""The viewer itself (drivers/viewer/viewer.py) needs the extra `view` and is imported when used."""
