"""From pixel to packet: what a chip's readout delays, orders and drops."""

from evs.emulator.sensor.readout.parameters import ReadoutParameters
from evs.emulator.sensor.readout.readout import Readout, make_readout
from evs.emulator.sensor.readout.state import CAUSES, ReadoutState

__all__ = ["CAUSES", "Readout", "ReadoutParameters", "ReadoutState", "make_readout"]
