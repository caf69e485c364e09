"""The closed loop in process: events and encoders to a controller, its controls back."""

from evs.emulator.simulation.closed_loop.closed_loop import ClosedLoop
from evs.msgs import Observation

__all__ = ["ClosedLoop", "Loop", "Observation"]

Loop = ClosedLoop
