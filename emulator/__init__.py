"""How events come about: world -> light -> sensor -> events. Names are imported at first use.

    world/        a MuJoCo model: physics in exact ticks, and what is seen of it
    render/       snapshots into light; renderers plug in at render/registry.py
    optics/       the lens in front
    sensor/       light into events: pixels, noise, readout, presets, frames (APS), IMU
    evsnet/       light into events by a trained network
    camera/       one camera: lens, renderer, event model and packets together
    simulation/   loops of worlds and cameras: World, EventCamera, Pixels, ClosedLoop
    state/        saved states

base/ and config/ are what all of them share; core/ is the C++ below.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from evs.msgs.registry import load

if TYPE_CHECKING:
    from evs.emulator.camera.camera import Camera
    from evs.emulator.camera.view import View
    from evs.emulator.simulation.closed_loop import ClosedLoop
    from evs.emulator.simulation.event_camera import EventCamera
    from evs.emulator.simulation.pixels import Pixels
    from evs.emulator.simulation.world import World
    from evs.emulator.simulation.worlds import Worlds
    from evs.emulator.world import LeftOutWarning, UnstableError, UnstableWarning
    from evs.msgs import Observation

_HOMES = {
    "Camera": "evs.emulator.camera.camera:Camera",
    "ClosedLoop": "evs.emulator.simulation.closed_loop:ClosedLoop",
    "EventCamera": "evs.emulator.simulation.event_camera:EventCamera",
    "LeftOutWarning": "evs.emulator.world:LeftOutWarning",
    "Observation": "evs.msgs:Observation",
    "Pixels": "evs.emulator.simulation.pixels:Pixels",
    "UnstableError": "evs.emulator.world:UnstableError",
    "UnstableWarning": "evs.emulator.world:UnstableWarning",
    "View": "evs.emulator.camera.view:View",
    "World": "evs.emulator.simulation.world:World",
    "Worlds": "evs.emulator.simulation.worlds:Worlds",
}

__all__ = [
    "Camera",
    "ClosedLoop",
    "EventCamera",
    "LeftOutWarning",
    "Observation",
    "Pixels",
    "UnstableError",
    "UnstableWarning",
    "View",
    "World",
    "Worlds",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'evs.emulator' has no attribute {name!r}")
    return load(_HOMES[name])


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
