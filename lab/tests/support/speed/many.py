"""Generated scenes of many geoms, and of many lamps."""

from __future__ import annotations

import mujoco
import numpy as np

from speed.view import View, view_of

SHAPES = ("sphere", "box", "capsule")
WORLD = """<mujoco><worldbody>
  <camera name="eye" pos="{eye}" xyaxes="1 0 0 0 {tilt} 1"/>
  <geom type="plane" size="{floor} {floor} 1"/>{lights}{geoms}
</worldbody></mujoco>"""


def _view(**fields: object) -> View:
    model = mujoco.MjModel.from_xml_string(WORLD.format(**fields))
    return view_of(model, mujoco.MjData(model), "eye")


def _lamp(x: float, y: float, height: float, cutoff: float, strength: float) -> str:
    return (
        f'<light pos="{x} {y} {height}" dir="0 0 -1" cutoff="{cutoff}"'
        f' diffuse="{strength} {strength} {strength}"/>'
    )


def _geoms(rng: np.random.Generator, places: np.ndarray, size: float) -> str:
    turns, colours = rng.normal(size=(len(places), 4)), rng.random((len(places), 3))
    lines = []
    for k, (place, turn, colour) in enumerate(zip(places, turns, colours, strict=True)):
        pos, quat, rgb = (" ".join(f"{x:.6f}" for x in v) for v in (place, turn, colour))
        lines.append(
            f'<geom type="{SHAPES[k % 3]}" size="{0.5 * size} {0.4 * size} {0.4 * size}"'
            f' pos="{pos}" quat="{quat}" rgba="{rgb} 1"/>'
        )
    return "".join(lines)


def many_geoms(count: int) -> View:
    """A box of 2 m full of spheres, boxes and capsules, whose volume together stays the same.

    One lamp stands above it, and a floor lies below.
    """
    rng = np.random.default_rng(0)
    places = rng.uniform(-1, 1, (count, 3)) + np.array([0, 0, 1.1])
    return _view(
        eye="0 -4 1.5", tilt=0.1, floor=4,
        lights=_lamp(0.5, 0.5, 4, 60, 0.8), geoms=_geoms(rng, places, 0.45 / np.cbrt(count)),
    )  # fmt: skip


def hall(lamps: int) -> View:
    """Thirty geoms on a floor, under lamps of which about five reach each place.

    Args:
        lamps: 100: in a grid of 2 m, each lights a disc of 2.5 m; 5: near each other, and each
            lights everything.
    """
    if lamps == 100:
        grid = np.arange(-9, 10, 2)
        lights = [_lamp(x, y, 3, 40, 0.2) for x in grid for y in grid]
    else:
        lights = [_lamp(0.2 * k - 0.4, 0, 6, 80, 0.2) for k in range(lamps)]
    rng = np.random.default_rng(1)
    places = np.column_stack([rng.uniform(-2, 2, (30, 2)), rng.uniform(0.2, 1.5, 30)])
    return _view(
        eye="0 -6 2.5", tilt=0.4, floor=10,
        lights="".join(lights), geoms=_geoms(rng, places, 0.3),
    )  # fmt: skip
