"""How events come about: world -> light -> sensor -> events. Names are imported at first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evs.emulator.camera import Camera
    from evs.emulator.closed import Loop, Observation
    from evs.emulator.loop import World
    from evs.emulator.observe import Sensor
    from evs.emulator.view import View
    from evs.emulator.virtual import VirtualCamera
    from evs.emulator.world import LeftOutWarning, UnstableError

__all__ = [
    "Camera",
    "LeftOutWarning",
    "Loop",
    "Observation",
    "Sensor",
    "UnstableError",
    "View",
    "VirtualCamera",
    "World",
]


def __getattr__(name: str) -> Any:
    # written out, so that the house's rules see every import
    if name == "Camera":
        return import_module("evs.emulator.camera").Camera
    if name == "LeftOutWarning":
        return import_module("evs.emulator.world").LeftOutWarning
    if name == "Loop":
        return import_module("evs.emulator.closed").Loop
    if name == "Observation":
        return import_module("evs.emulator.closed").Observation
    if name == "Sensor":
        return import_module("evs.emulator.observe").Sensor
    if name == "UnstableError":
        return import_module("evs.emulator.world").UnstableError
    if name == "View":
        return import_module("evs.emulator.view").View
    if name == "VirtualCamera":
        return import_module("evs.emulator.virtual").VirtualCamera
    if name == "World":
        return import_module("evs.emulator.loop").World
    raise AttributeError(f"module 'evs.emulator' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
