"""Workers: a sink in a process of its own, so that the camera's process only copies packets."""

from evs.drivers.run.worker.sink import WorkerSink

__all__ = ["WorkerSink"]
