"""Sinks aside: a sink in a process of its own, so that the camera's only copies its packets."""

from evs.drivers.run.worker.sink import AsideSink

__all__ = ["AsideSink"]
