"""What a comparison with another program needs: a scene, one instant of it, a camera, a pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import (
    CameraModel,
    CameraPose,
    Light,
    LightKind,
    Mesh,
    SceneModel,
    SceneSnapshot,
    Shape,
    Surface,
    Texture,
)
from evs.emulator.config import RenderConfig
from reference.scenes import scene_of, shot_of

F64 = npt.NDArray[np.float64]
Vector = tuple[float, float, float]
EYE = np.eye(3)


@dataclass(frozen=True)
class Stage:
    """A scene at one instant and the camera that sees it."""

    scene: SceneModel
    shot: SceneSnapshot
    camera: CameraModel
    pose: CameraPose
    render: RenderConfig = field(
        default_factory=lambda: RenderConfig(headlight="model", sky="light")
    )
    bounces: int = 0
    """off surfaces, between eye and lamp; -1: only what glows of itself is seen"""
    path: bool = False
    """as `path` has it: lamps are balls of their bulbradius, materials may be glossy"""
    sky_radiance: Callable[[F64], F64] = lambda direction: np.zeros_like(direction)
    """(..., 3) world directions to (..., 3) linear radiance: what the skybox shows there"""


@dataclass
class Builder:
    """Collects geoms and lights; `look` makes the stage."""

    geoms: list[tuple[Shape, tuple[float, ...], F64, F64, int, int]] = field(default_factory=list)
    surfaces: list[Surface] = field(default_factory=list)
    meshes: list[Mesh] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    places: list[tuple[Vector, F64]] = field(default_factory=list)
    skybox: int = -1

    def add(
        self,
        shape: Shape,
        size: tuple[float, ...],
        pos: Vector,
        surface: Surface,
        *,
        turn: F64 = EYE,
        mesh: Mesh | None = None,
    ) -> None:
        """One geom, turned and then moved."""
        self.surfaces.append(surface)
        if mesh is not None:
            self.meshes.append(mesh)
        index = -1 if mesh is None else len(self.meshes) - 1
        place = np.array(pos, np.float64)
        self.geoms.append((shape, size, place, turn, len(self.surfaces) - 1, index))

    def shine(
        self, kind: LightKind, pos: Vector = (0, 0, 0), towards: Vector = (0, 0, -1), **light: Any
    ) -> None:
        """One light; fades with the square of the distance, and its highlights are its image."""
        direction = np.array(towards, np.float64)
        plain = Light(kind, attenuation=(0.0, 0.0, 1.0), exponent=0.0, range_m=0.0, softness=0.0)
        shining = replace(plain, **light)
        self.lights.append(replace(shining, specular=shining.diffuse))
        self.places.append((pos, direction / np.linalg.norm(direction)))

    def look(
        self,
        eye: Vector,
        at: Vector,
        *,
        size: tuple[int, int] = (48, 36),
        fovy_deg: float = 45.0,
        principal: tuple[float, float] | None = None,
        orthographic: bool = False,
        **more: Any,
    ) -> Stage:
        """The stage, seen from `eye`; orthographic: fovy_deg is the picture's height in m."""
        width, height = size
        half = fovy_deg / 2 if orthographic else np.tan(np.deg2rad(fovy_deg) / 2)
        focal = float(height / 2 / half)
        cx, cy = principal or (width / 2, height / 2)
        return Stage(
            self._model(),
            self._shot(),
            CameraModel(width, height, focal, focal, cx, cy, orthographic),
            CameraPose(np.array(eye, np.float64), facing(eye, at).ravel()),
            **more,
        )

    def _model(self) -> SceneModel:
        shapes, sizes, _, _, surfaces, meshes = zip(*self.geoms, strict=True)
        return scene_of(
            shapes,
            [[*s, 0, 0, 0][:3] for s in sizes],
            surface=surfaces,
            mesh=meshes,
            static=True,
            meshes=tuple(self.meshes),
            surfaces=tuple(self.surfaces),
            textures=tuple(self.textures),
            lights=tuple(self.lights),
            skybox=self.skybox,
        )

    def _shot(self) -> SceneSnapshot:
        return shot_of(
            self._model(),
            [geom[2] for geom in self.geoms],
            [geom[3].ravel() for geom in self.geoms],
            [pos for pos, _ in self.places],
            np.array([along for _, along in self.places], np.float64).reshape(-1, 3),
        )


def facing(eye: Vector, at: Vector) -> F64:
    """(3, 3) camera to world of a camera at `eye` that looks at `at`, z up."""
    back = np.asarray(eye, np.float64) - at
    back /= np.linalg.norm(back)
    up = np.array([0, 1, 0]) if abs(back[2]) > 0.999 else np.array([0, 0, 1])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back], axis=1)


def turned(axis: Vector, degrees: float) -> F64:
    """(3, 3) a rotation around an axis."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.deg2rad(degrees)
    return EYE + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def matt(grey: float, **more: Any) -> Surface:
    """A Lambert surface of this linear reflectance."""
    return matt_rgb((grey, grey, grey), **more)


def matt_rgb(colour: Vector, **more: Any) -> Surface:
    """A Lambert surface of this linear colour; `more` adds to it."""
    c = np.asarray(colour, np.float64)
    coded = np.where(c <= 0.04045 / 12.92, c * 12.92, 1.055 * c ** (1 / 2.4) - 0.055)
    red, green, blue = (float(v) for v in coded)
    return replace(Surface((red, green, blue, 1.0), specular=0.0, shininess=0.0), **more)
