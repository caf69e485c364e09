"""What an event model is made from."""

from __future__ import annotations

from dataclasses import dataclass

from evs.emulator.base.features import Switches
from evs.emulator.config import ModelConfig
from evs.emulator.sensor.parameters import SensorParameters


@dataclass(frozen=True)
class ModelRequest:
    """The arguments of camera.event_models.make_event_model, for the function in a row."""

    sensor: SensorParameters
    model: ModelConfig
    threads: int
    """0 is one a core"""
    spp: int
    """samples a pixel of light with noise; 0: it has none"""
    switches: Switches
    isa: str
