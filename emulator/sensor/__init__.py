"""Light into events: sensor parameters and presets, log map, event models."""

from evs.emulator.sensor.aps import Aps, ApsState
from evs.emulator.sensor.imu import Imu, ImuState
from evs.emulator.sensor.parameters import (
    ApsParameters,
    ImuParameters,
    ReadoutParameters,
    SensorParameters,
)
from evs.emulator.sensor.pixel import PlainModel, PlainState
from evs.emulator.sensor.presets import (
    completed,
    describe_sensor,
    preset_biases,
    preset_names,
    resolve_sensor,
)
from evs.emulator.sensor.readout import Readout, ReadoutState, make_readout

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
    "describe_sensor",
    "make_readout",
    "preset_biases",
    "preset_names",
    "resolve_sensor",
]
