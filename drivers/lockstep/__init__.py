"""The closed loop over ZeroMQ: controllers in other processes, physics in lock-step with them."""

from evs.drivers.lockstep.client import RemoteLoop, connect
from evs.drivers.lockstep.server import LockstepServer

__all__ = ["LockstepServer", "RemoteLoop", "connect"]
