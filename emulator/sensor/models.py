"""Event models by name."""

from __future__ import annotations

from evs.emulator.config import ModelConfig
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.plain import PlainModel
from evs.emulator.stages import EventModel
from evs.msgs import unknown

MODELS = {"plain": PlainModel}


def make_event_model(sensor: SensorParameters, model: ModelConfig, threads: int = 0) -> EventModel:
    """The event model that `model.name` names. Threads: 0 is one a core. Raises EvsError."""
    if model.name not in MODELS:
        raise unknown("model", model.name, MODELS)
    return MODELS[model.name](sensor, threads)
