"""Configuration: one frozen dataclass for each table of a pipeline file."""

from evs.emulator.config.biases import BiasConfig
from evs.emulator.config.closed_loop import DelayConfig, LimitConfig, LoopConfig
from evs.emulator.config.renderers import RENDERERS, SEEDS, RendererRow
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
    "RENDERERS",
    "SEEDS",
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
    "RendererRow",
    "RunConfig",
    "SceneConfig",
    "SensorConfig",
]
