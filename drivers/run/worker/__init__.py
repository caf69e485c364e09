"""Workers run a sink in its own process, so that the camera's process only copies packets."""

from evs.drivers.run.worker.sink import WorkerSink

__all__ = ["WorkerSink"]
