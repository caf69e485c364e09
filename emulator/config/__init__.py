"""Configuration: one frozen dataclass for each table of a pipeline file."""

from evs.emulator.config.schema import (
    CameraConfig,
    DelayConfig,
    FlickerConfig,
    LimitConfig,
    LoopConfig,
    ModelConfig,
    PlanConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
    VisualConfig,
)
from evs.emulator.config.sensor import ApsConfig, BiasConfig, ImuConfig, ReadoutConfig, SensorConfig

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
    "VisualConfig",
]
