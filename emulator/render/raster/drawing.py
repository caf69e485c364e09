"""What there is to draw, in numbers, under the names that shade.frag has for them. numpy only."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from evs.emulator.base.scene import (
    F32,
    F64,
    U8,
    CameraModel,
    CameraPose,
    Light,
    SceneModel,
    SceneSnapshot,
    Shape,
    Surface,
    TextureKind,
)
from evs.emulator.config import RenderConfig
from evs.emulator.render.flicker import Flicker
from evs.emulator.render.raster.tessellate import UNIT_CAPSULE, TriangleMesh, sky_box, tessellate

FLAT, CUBE = 0, 1
"""texture_kind in shade.frag, and the texture units."""

Uniforms = dict[str, Any]
"""name -> bool, int, float, (3,) float, (n,) int, (n, 1) or (n, 3) float"""

NEAR, FAR, FAR_FLAT = 2e-3, 4e3, 400.0
"""Where a perspective view begins and ends, and where an orthographic one ends: scene extents.
A 32-bit depth of 1 - NEAR / FAR is still well below 1."""


@dataclass(frozen=True)
class DrawCall:
    """One object to draw."""

    triangles: TriangleMesh
    material: Uniforms
    texture: int
    """index into SceneModel.textures, -1 none"""


def from_srgb(coded: F64) -> F64:
    """Display-coded to linear (IEC 61966-2-1)."""
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)


def linear_texels(image: U8, srgb: bool) -> F32:
    """(h, w, 3) linear light of an image (h, w, c)."""
    rgb = image[..., :3] if image.shape[-1] >= 3 else np.repeat(image[..., :1], 3, axis=-1)
    coded = rgb / 255.0
    return np.ascontiguousarray(from_srgb(coded) if srgb else coded, np.float32)


def smaller_versions(texels: F32) -> Iterator[F32]:
    """The image (h, w, 3) itself, then halves of it by area down to (1, 1, 3)."""
    image = texels.astype(np.float64)
    while True:
        yield np.ascontiguousarray(image, np.float32)
        height, width = image.shape[:2]
        if height == width == 1:
            return
        image = _halved(_halved(image).transpose(1, 0, 2)).transpose(1, 0, 2)


def _halved(image: F64) -> F64:
    """Half as many rows, each the mean of what it covers."""
    rows = len(image)
    if rows == 1:
        return image
    if rows % 2 == 0:
        return np.asarray(0.5 * (image[0::2] + image[1::2]))
    half = rows // 2
    edges = np.arange(half + 1) * (rows / half)
    share = np.minimum(edges[1:, None], np.arange(1, rows + 1))
    share -= np.maximum(edges[:-1, None], np.arange(rows))
    return np.tensordot(np.maximum(share, 0) * (half / rows), image, 1)


def is_cube(scene: SceneModel, surface: Surface) -> bool:
    """Whether a surface's texture is a cube."""
    return surface.texture >= 0 and scene.textures[surface.texture].kind is not TextureKind.FLAT


def surface_uniforms(scene: SceneModel, geom: int, surface: Surface) -> Uniforms:
    """What a geom looks like."""
    kind = CUBE if is_cube(scene, surface) else FLAT
    return {
        "geom": float(geom + 1),
        "sky": False,
        "albedo": from_srgb(np.array(surface.rgba[:3])),
        "texture_kind": kind if surface.texture >= 0 else -1,
        "alpha": min(float(surface.rgba[3]), 1.0),
        "emission": float(surface.emission),
        "specular": float(from_srgb(np.array(surface.specular))),
        "exponent": float(surface.shininess) * 128.0,
    }


def draw_calls(scene: SceneModel, orthographic: bool) -> Iterator[DrawCall]:
    """Every geom in its order, then the sky if there is one."""
    extent_m, stretching = extent_of(scene), set(scene.stretching.tolist())
    for geom, kind in enumerate(scene.geom_type):
        surface = scene.surfaces[scene.geom_surface[geom]]
        index = int(scene.geom_mesh[geom])
        mesh = scene.meshes[index] if index >= 0 else None
        size, cube = scene.geom_size[geom], is_cube(scene, surface)
        if geom in stretching:
            size = UNIT_CAPSULE
        triangles = tessellate(Shape(int(kind)), size, mesh, surface, cube, extent_m)
        yield DrawCall(triangles, surface_uniforms(scene, geom, surface), surface.texture)
    if scene.skybox >= 0:
        material: Uniforms = {"geom": 0.0, "sky": True, "alpha": 1.0}
        material |= {"albedo": np.ones(3), "texture_kind": CUBE}
        span = 0.25 * FAR_FLAT if orthographic else 0.5 * FAR
        yield DrawCall(sky_box(span * extent_m), material, scene.skybox)


def extent_of(scene: SceneModel) -> float:
    """The scene's size in m, never 0."""
    return max(scene.extent_m, 1e-9)


def pose_matrix(turn: F64, position: F64) -> F64:
    """(4, 4) local to world."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn.reshape(3, 3), position
    return out


def orthographic_matrix(camera: CameraModel, extent_m: float) -> F64:
    """(4, 4) from the camera's frame to OpenGL's cube, which begins at the near plane."""
    near, far = camera.near_m, FAR_FLAT * extent_m
    out = np.diag(
        [2 * camera.fx / camera.width, 2 * camera.fy / camera.height, -2 / (far - near), 1.0]
    )
    out[:3, 3] = (
        2 * camera.cx / camera.width - 1,
        1 - 2 * camera.cy / camera.height,
        -(far + near) / (far - near),
    )
    return out


class LightUniforms:
    """The lights that a renderer uses, as shade.frag wants them."""

    def __init__(self, scene: SceneModel, config: RenderConfig) -> None:
        """Image lights are left out: OpenGL has none."""
        headlight, lux_per_unit = config.headlight == "model", config.lux_per_unit
        used = [
            i
            for i, x in enumerate(scene.lights)
            if (headlight or not x.headlight) and not x.is_image
        ]
        self._flicker = Flicker(scene.lights, config.flicker)
        self._at_camera = np.array([[scene.lights[i].headlight] for i in used], bool)
        self._used = used
        self.constant = light_uniforms([scene.lights[i] for i in used], lux_per_unit)

    def __len__(self) -> int:
        return len(self._used)

    def at(self, snapshot: SceneSnapshot, pose: CameraPose) -> Uniforms:
        """Where they are, with the camera as the origin, and where they point."""
        if not self._used:
            return {}
        ahead = -pose.mat.reshape(3, 3)[:, 2]
        places = snapshot.light_pos[self._used] - pose.pos
        moving: Uniforms = {
            "light_position": np.where(self._at_camera, 0.0, places),
            "light_direction": np.where(self._at_camera, ahead, snapshot.light_dir[self._used]),
        }
        if not self._flicker.steady:
            gains = self._flicker.gains(snapshot)[self._used, np.newaxis]
            for name in ("light_ambient", "light_diffuse", "light_specular"):
                moving[name] = self.constant[name] * gains
        return moving


def light_uniforms(lights: list[Light], lux_per_unit: float) -> Uniforms:
    """What never moves of the lights: each number by its name, and what shade.frag makes of some.

    A physical intensity counts instead of the colours' size.
    """
    if not lights:
        return {"light_count": 0}
    numbers = {
        f"light_{x.name}": np.array([getattr(light, x.name) for light in lights], np.float64)
        for x in fields(Light)
        if x.name != "name"
    }
    numbers = {name: values.reshape(len(lights), -1) for name, values in numbers.items()}
    intensity, range_m = numbers["light_intensity"], numbers["light_range_m"]
    cutoff_deg = numbers["light_cutoff_deg"]
    cosine = np.cos(np.deg2rad(cutoff_deg))
    inner = np.cos(np.deg2rad((1.0 - numbers["light_softness"]) * cutoff_deg))
    physical = intensity > 0
    # directional: lux; else candela, which falls off with the square of the distance
    scale = np.where(physical, intensity / lux_per_unit, 1.0)
    edge = 1.0 / np.maximum(inner - cosine, 1.0 / 1024)
    has_end = physical & (range_m > 0)
    return numbers | {
        "light_count": len(lights),
        "light_kind": numbers["light_kind"].astype(np.int32),
        "light_ambient": np.where(physical, 0.0, numbers["light_ambient"]),
        "light_diffuse": scale * numbers["light_diffuse"],
        "light_specular": scale * numbers["light_specular"],
        "light_attenuation": np.where(physical, [0.0, 0.0, 1.0], numbers["light_attenuation"]),
        "light_cone": np.hstack([cosine, numbers["light_exponent"], np.where(physical, edge, 0.0)]),
        "light_fade": np.where(has_end, np.where(has_end, range_m, 1.0) ** -2, 0.0),
    }
