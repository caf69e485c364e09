"""Live pictures of a stream: windows of events, for Rerun's viewer and for a terminal."""

from evs.drivers.view.sink import ViewSink
from evs.drivers.view.sketch import sketch
from evs.drivers.view.windows import PERIOD_US, Gatherer, Window

__all__ = ["PERIOD_US", "Gatherer", "ViewSink", "Window", "sketch"]
"""The viewer itself (drivers/view/viewer.py) needs the extra `view` and is imported when used."""
