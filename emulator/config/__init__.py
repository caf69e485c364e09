"""Configuration: one frozen dataclass for each table of a pipeline file."""

from evs.emulator.config.biases import BiasConfig
from evs.emulator.config.closed_loop import DelayConfig, LimitConfig, LoopConfig
from evs.emulator.config.schema import (
    SEEDS,
    SPP,
    ApsConfig,
    CameraConfig,
    FlickerConfig,
    ImuConfig,
    ModelConfig,
    PlanConfig,
    ReadoutConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
    SensorConfig,
)

__all__ = [
    "SEEDS",
    "SPP",
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
