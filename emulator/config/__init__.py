"""Configuration: one frozen dataclass for each table of a pipeline file."""

from evs.emulator.config.biases import BiasConfig
from evs.emulator.config.closed_loop import DelayConfig, LimitConfig, LoopConfig
from evs.emulator.config.schema import (
    CameraConfig,
    FlickerConfig,
    ModelConfig,
    PlanConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
)
from evs.emulator.config.sensor import ApsConfig, ImuConfig, ReadoutConfig, SensorConfig

__all__ = [
    "ApsConfig",
    "BiasConfig",
    "CameraConfig",
    "DelayConfig",
    "FlickerConfig",
    "ImuConfig",
    "LimitConfig",
    "LoopConfig",
    "ModelConfig",
    "PlanConfig",
    "ReadoutConfig",
    "RenderConfig",
    "RunConfig",
    "SceneConfig",
    "SensorConfig",
]
