"""Light into events: sensor parameters and presets, log map, event models."""

from evs.emulator.sensor.aps import Aps, ApsState
from evs.emulator.sensor.imu import Imu, ImuState
from evs.emulator.sensor.parameters import ApsParameters, ImuParameters, SensorParameters
from evs.emulator.sensor.pixel.plain import PlainModel
from evs.emulator.sensor.pixel.state import PlainState
from evs.emulator.sensor.presets.resolve import (
    completed,
    preset_biases,
    preset_names,
    resolve_sensor,
)
from evs.emulator.sensor.readout import Readout, ReadoutParameters, ReadoutState, make_readout

__all__ = [
    "Aps",
    "ApsParameters",
    "ApsState",
    "Imu",
    "ImuParameters",
    "ImuState",
    "PlainModel",
    "PlainState",
    "Readout",
    "ReadoutParameters",
    "ReadoutState",
    "SensorParameters",
    "completed",
    "make_readout",
    "preset_biases",
    "preset_names",
    "resolve_sensor",
]
