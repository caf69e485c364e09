"""The whole event pixel in NumPy and plain Python, written for reading: the oracle of core/sensor.

It gives the native pixel's events and state byte for byte, and imports nothing native. It is
written from the contracts in the headers, it leaves no pixel out, and it is slow.
"""

from evs.emulator.sensor.reference.light import log_light, natural_log
from evs.emulator.sensor.reference.model import ReferenceModel, caught_up

__all__ = ["ReferenceModel", "caught_up", "log_light", "natural_log"]
