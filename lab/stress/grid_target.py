"""The grid target: glowing plates in front of an orthographic camera, of exactly known light.

A plate is a whole number of pixels wide and the grid moves by whole pixels, so every sample of a
pixel lies on one plate and its light is the emission of the plate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F64
from evs.emulator.world import ORTHOGRAPHIC
from evs_lab.stress.capture import Capture, capture
from evs_lab.stress.closed_form import NEAR, count_error, residual_thresholds

HEIGHT_PX = 8
"""of the picture; a pixel is 1 m"""

FLASH_PX = 16
"""width of a picture that shows one plate at a time"""


def grid_mjcf(levels: Sequence[float], plate_px: int, more: str = "") -> str:
    """MJCF: the plates side by side on a mocap body, the first at its origin.

    Args:
        levels: what each emits.
        plate_px: width of a plate.
        more: further elements of the world.
    """
    materials = "".join(
        f'<material name="level{k}" {_glow(level)}/>' for k, level in enumerate(map(float, levels))
    )
    plates = "".join(
        f'<geom type="box" size="{plate_px / 2} {2 * HEIGHT_PX} .25" '
        f'pos="{(k + 0.5) * plate_px} 0 0" material="level{k}"/>'
        for k in range(len(levels))
    )
    return f"""<mujoco><option timestep="1000"/><statistic extent="1"/>
<visual><headlight active="0"/></visual><asset>{materials}</asset>
<worldbody><camera name="eye" pos="0 0 9" {ORTHOGRAPHIC} fovy="{HEIGHT_PX}"/>
<body name="wall" mocap="true">{plates}</body>{more}</worldbody></mujoco>"""


def _glow(level: float) -> str:
    """A material's emission. MuJoCo 3 reads no denormal number: a dark colour does the rest."""
    if not 0.0 < level < float(np.finfo(np.float32).tiny):
        return f'rgba="1 1 1 1" emission="{level!r}"'
    # in the straight part of the sRGB curve
    coded = repr(12.92 * 2.0**-40)
    return f'rgba="{coded} {coded} {coded} 1" emission="{level * 2.0**40!r}"'


def place(world: World, first_px: int) -> None:
    """Move the grid so that the left column of the picture shows its column `first_px`."""
    half_px = world.cameras[0].info.width / 2
    world.data.mocap_pos[0] = (-half_px - first_px, 0.0, 0.0)


@dataclass(frozen=True)
class GridCapture:
    """A capture of the grid target, and the light that it should have seen."""

    capture: Capture
    light: F64
    """(ticks + 1, h, w) what each pixel sees at the end of each tick, by the plates' emissions"""
    tick_us: int

    @property
    def wrong(self) -> float:
        """Events too many or too few, summed over pixels, ticks and polarities."""
        return count_error(self.capture.events, self.light, self.tick_us)

    @property
    def is_explained(self) -> bool:
        """Whether the events of every pixel add up to its light at the end, within a threshold."""
        return residual_thresholds(self.capture.events, self.light[0], self.light[-1]) < 1.0 + NEAR


def capture_scene(
    mjcf: str,
    ticks: int,
    act: Callable[[int, World], None],
    tables: Mapping[str, Any] | None = None,
    files: Mapping[str, bytes] | None = None,
) -> GridCapture:
    """Capture any scene in ticks of 1 ms; the light of each pixel is the renderer's.

    Args:
        mjcf: text of the scene.
        ticks: how many.
        act: as for `capture`; what it moves before the first tick is already in the reference.
        tables: of the pipeline.
        files: as for `capture`.
    """
    light: list[F64] = []

    def record(tick: int, world: World) -> None:
        if tick:
            light.append(np.asarray(world.cameras[0].luminance, np.float64))
        act(tick, world)

    seen = capture(mjcf, ticks / 1e3, dict(tables or {}), record, files=files)
    return GridCapture(seen, np.array([light[0], *light]), 1000)


def capture_grid(
    levels: Sequence[float],
    firsts: Sequence[int],
    width_px: int,
    plate_px: int = 1,
    tables: Mapping[str, Any] | None = None,
    more: str = "",
    first: Callable[[World], None] | None = None,
) -> GridCapture:
    """Capture a grid whose column firsts[k] is the left one of the picture in tick k + 1.

    Args:
        levels: as for `grid_mjcf`.
        firsts: left column of each tick; the reference shows firsts[0] too.
        width_px: width of the picture.
        plate_px: as for `grid_mjcf`.
        tables: of the pipeline.
        more: as for `grid_mjcf`.
        first: called with the world before the first tick.
    """
    config = dict(tables or {})
    config["sensor"] = {"width": width_px, "height": HEIGHT_PX, **config.get("sensor", {})}
    tick_us = int(config.get("scene", {}).get("tick_us", 1000))

    def act(tick: int, world: World) -> None:
        if tick == 0 and first is not None:
            first(world)
        place(world, firsts[min(tick, len(firsts) - 1)])

    seen = capture(grid_mjcf(levels, plate_px, more), len(firsts) * tick_us / 1e6, config, act)
    columns = np.repeat(np.asarray(levels, np.float64), plate_px)
    rows = np.array([columns[first : first + width_px] for first in (firsts[0], *firsts)])
    light = np.repeat(rows[:, np.newaxis], HEIGHT_PX, 1)
    return GridCapture(seen, light, tick_us)


def capture_flashes(
    levels: Sequence[float],
    tables: Mapping[str, Any] | None = None,
    first: Callable[[World], None] | None = None,
) -> GridCapture:
    """Capture uniform light, another level in each tick."""
    firsts = [place * FLASH_PX for place in range(len(levels))]
    return capture_grid(levels, firsts, FLASH_PX, FLASH_PX, tables, first=first)
