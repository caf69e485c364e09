"""Scenes written by hand: geoms by shape and size, their places, and a plain camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.features import Switches
from evs.emulator.base.scene import CameraModel, Light, LightKind, SceneModel, SceneSnapshot, Shape

SUN = Light(LightKind.DIRECTIONAL)
SAMPLED_OUTLINES = Switches(off=frozenset({"outlines"}))
"""for tests of what each ray meets"""


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
    """Make a scene of geoms.

    Args:
        shapes: The shapes of the n geoms.
        sizes: Their sizes (n, 3), m.
        surface: The index of each geom's surface, (n,) whole numbers; the first one if None.
        mesh: The index of each geom's mesh, (n,) whole numbers; the first one if None. It counts
            only for shapes that have a mesh.
        static: Whether each geom is static, (n,) bool, or one value for all.
        lights: The lights; by default a sun.
        **more: Other fields of SceneModel.
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
    """Make a snapshot of a scene of n geoms and m lights.

    Args:
        scene: The scene.
        places: The positions of the geoms, (n, 3), m.
        mats: Their rotations (n, 9), row-major; upright if None.
        lamps: The positions of the lights, (m, 3), m; 4 m above the origin if None.
        shining: The directions in which the lights shine, (m, 3), or one (3,) for all.
        t_us: The time of the snapshot.
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
    """Make a camera with square pixels whose optical axis passes through the middle.

    Args:
        width: Width of the picture, px.
        height: Height of the picture, px.
        focal: The focal length, px; px/m if the camera is orthographic.
        orthographic: Whether the projection is orthographic.
    """
    return CameraModel(width, height, focal, focal, width / 2, height / 2, orthographic)
