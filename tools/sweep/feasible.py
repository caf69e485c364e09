"""Find the points that can be measured on this machine, before anything is measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from evs.drivers.run.paths import in_package
from evs.emulator import World
from evs.emulator.config import RenderConfig, SensorConfig
from evs.msgs import EvsError
from evs.tools.sweep.pixels import check_tick
from evs.tools.sweep.points import SweepPoint

_SCENE = "evs:config/scenes/pendulum.xml"


def feasible(points: Sequence[SweepPoint], warn: Callable[[str], None]) -> list[SweepPoint]:
    """Those that can be measured; of the others a line, once for each reason."""
    found: list[SweepPoint] = []
    reported: set[str] = set()
    for point in points:
        reason = _reason(point)
        if not reason:
            found.append(point)
        elif reason not in reported:
            reported.add(reason)
            warn(f"{point.preset}, {point.axis} {point.value} is left out: {reason}")
    return found


def _reason(point: SweepPoint) -> str:
    """Why not; empty: it can."""
    config = point.config
    try:
        check_tick(config.model, config.scene.tick_us)
        if config.render.renderer == "raster":
            _draw_once()
    except EvsError as error:
        return str(error)
    return ""


def _draw_once() -> None:
    """One small picture by OpenGL. Raises EvsError where the extra or OpenGL is not there."""
    small = SensorConfig(preset="ideal", width=16, height=12)
    view = World(in_package(_SCENE)).add_view(sensor=small, render=RenderConfig(renderer="raster"))
    view.render()
