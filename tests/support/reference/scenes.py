"""Scenes written by hand: geoms by shape and size, where they are, and a plain camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import CameraModel, Light, LightKind, SceneModel, SceneSnapshot, Shape

SUN = Light(LightKind.DIRECTIONAL)


def scene_of(
    shapes: Sequence[Shape],
    sizes: npt.ArrayLike,
    *,
    surface: npt.ArrayLike | None = None,
    mesh: npt.ArrayLike | None = None,
    static: npt.ArrayLike = False,
    lights: tuple[Light, ...] = (SUN,),
    **more: Any,
) -> SceneModel:
    """Geoms of these shapes and sizes (n, 3), in the light of a sun unless there are other lights.

    In: surface (n), of each geom, the first; mesh (n), where a shape has one, the first; static
    (n) or one for all; more, any other field of SceneModel.
    """
    count = len(shapes)
    index = np.zeros(count, np.int32) if mesh is None else np.asarray(mesh, np.int32)
    has_mesh = [shape in (Shape.MESH, Shape.HFIELD) for shape in shapes]
    return SceneModel(
        geom_type=np.array(shapes, np.int32),
        geom_size=np.asarray(sizes, np.float32).reshape(count, 3),
        geom_mesh=np.where(has_mesh, index, -1).astype(np.int32),
        geom_surface=np.zeros(count, np.int32) if surface is None else np.array(surface, np.int32),
        geom_id=np.arange(count, dtype=np.int32),
        geom_static=np.broadcast_to(np.asarray(static, np.bool_), count).copy(),
        lights=lights,
        **more,
    )


def shot_of(
    scene: SceneModel,
    places: npt.ArrayLike,
    mats: npt.ArrayLike | None = None,
    lamps: npt.ArrayLike | None = None,
    shining: npt.ArrayLike = (0.0, 0.0, -1.0),
    t_us: int = 0,
) -> SceneSnapshot:
    """Geoms at `places` (n, 3), upright unless `mats` (n, 9) says else.

    In: lamps, where the lights are, 4 m up; shining, where their light goes, of one or all (nl, 3).
    """
    count, lights = len(scene.geom_type), len(scene.lights)
    upright, up = np.tile(np.eye(3).reshape(9), (count, 1)), np.tile([0.0, 0.0, 4.0], (lights, 1))
    return SceneSnapshot(
        t_us,
        np.asarray(places, np.float64).reshape(count, 3),
        upright if mats is None else np.asarray(mats, np.float64).reshape(count, 9),
        up if lamps is None else np.asarray(lamps, np.float64).reshape(lights, 3),
        np.broadcast_to(np.asarray(shining, np.float64), (lights, 3)).copy(),
    )


def camera_of(width: int, height: int, focal: float, orthographic: bool = False) -> CameraModel:
    """Square pixels, the optical axis through the middle. In: focal, px; orthographic: px/m."""
    return CameraModel(width, height, focal, focal, width / 2, height / 2, orthographic)
