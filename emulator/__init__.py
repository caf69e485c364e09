"""How events come about: world -> light -> sensor -> events. Names are imported at first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evs.emulator.camera.camera import Camera
    from evs.emulator.camera.view import View
    from evs.emulator.simulation.closed_loop import Loop, Observation
    from evs.emulator.simulation.event_camera import Sensor
    from evs.emulator.simulation.virtual_camera import VirtualCamera
    from evs.emulator.simulation.world import World
    from evs.emulator.world import LeftOutWarning, UnstableError

_HOMES = {
    "Camera": "evs.emulator.camera.camera",
    "LeftOutWarning": "evs.emulator.world",
    "Loop": "evs.emulator.simulation.closed_loop",
    "Observation": "evs.emulator.simulation.closed_loop",
    "Sensor": "evs.emulator.simulation.event_camera",
    "UnstableError": "evs.emulator.world",
    "View": "evs.emulator.camera.view",
    "VirtualCamera": "evs.emulator.simulation.virtual_camera",
    "World": "evs.emulator.simulation.world",
}

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
    if name not in _HOMES:
        raise AttributeError(f"module 'evs.emulator' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
