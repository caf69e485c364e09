"""Event models by name."""

from __future__ import annotations

from evs.emulator.config import ModelConfig
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.pixel.plain import PlainModel
from evs.emulator.sensor.pixel.running_mean import RunningMeanConstants
from evs.emulator.stages import EventModel
from evs.msgs import unknown

MODELS = {"plain": None, "adaptive": RunningMeanConstants()}
"""name -> the running mean in front of the pixel"""


def make_event_model(sensor: SensorParameters, model: ModelConfig, threads: int = 0) -> EventModel:
    """The event model that `model.name` names. Threads: 0 is one a core. Raises EvsError."""
    if model.name not in MODELS:
        raise unknown("model", model.name, MODELS)
    return PlainModel(sensor, threads, average=MODELS[model.name], causes=model.labels)
