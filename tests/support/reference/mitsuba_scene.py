"""A SceneModel, snapshot and camera as a Mitsuba 3 scene: the same light by another program.

Conventions: a light of strength 1 gives a white Lambert surface that faces it a radiance of 1; for
Mitsuba, that is an irradiance of pi. Light passes through our surfaces from behind, while Mitsuba's
block it and are black there: convert only scenes that are seen, and lit, from the front. What
Mitsuba cannot show (ambient light from lamps, cones with an exponent, attenuation other than 1/r^2)
is refused.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import Light, LightKind, Mesh, Shape, Surface, TextureKind
from reference.closed_forms import linear
from reference.stage import Stage
from reference.tessellation import ball

mi.set_variant("scalar_rgb")

F64 = npt.NDArray[np.float64]
WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
"""The weights of linear BT.709 colours in luminance."""
FAR = 1e4
"""Half the width of an infinite plane, m: at a height of 1 m, the horizon is off by 1e-4 rad."""


def rgb(values: npt.ArrayLike) -> dict[str, Any]:
    """A colour as Mitsuba takes it."""
    return {"type": "rgb", "value": [float(v) for v in np.broadcast_to(values, 3)]}


def pose(pos: npt.ArrayLike, mat: npt.ArrayLike) -> F64:
    """The transform from local to world coordinates, (4, 4)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = np.reshape(mat, (3, 3)), pos
    return out


def scaled(frame: F64, size: npt.ArrayLike) -> Any:
    """Mitsuba's transform that applies first the scale, then the frame."""
    return mi.ScalarTransform4f(frame @ np.diag([*np.asarray(size, np.float64), 1.0]))


def mitsuba_scene(stage: Stage, integrator: str) -> Any:
    """Load the scene into Mitsuba; `render` makes pictures of it.

    Args:
        stage: The scene, its snapshot, its camera and the settings of the renderer.
        integrator: `path`, or `volpath` where light passes through transparent surfaces.
    """
    found: dict[str, Any] = {
        "type": "scene",
        # the same number of edges from the eye to the lamp; no Russian roulette
        "integrator": {"type": integrator, "max_depth": stage.bounces + 2, "rr_depth": 1000},
        "sensor": _sensor(stage),
    }
    for index, shape in enumerate(stage.scene.geom_type):
        found |= {
            f"geom{index}_{part}": value
            for part, value in enumerate(_geom(stage, index, Shape(int(shape))))
        }
    for index, light in enumerate(stage.scene.lights):
        found[f"light{index}"] = _light(stage, index, light)
    dome = sum(np.asarray(light.ambient) for light in stage.scene.lights)
    if stage.scene.skybox >= 0:
        found["sky"] = _sky(stage, dome)
    elif np.any(dome):
        found["sky"] = {"type": "constant", "radiance": rgb(dome)}
    return mi.load_dict(found)


def render(scene: Any, batches: int, spp: int, seed: int = 0) -> F64:
    """Render luminance (batches, h, w); each batch has `spp` independent samples per pixel."""
    pictures = [mi.render(scene, spp=spp, seed=seed * batches + k) for k in range(batches)]
    return np.stack([np.asarray(picture, np.float64) @ WEIGHTS for picture in pictures])


def _sensor(stage: Stage) -> dict[str, Any]:
    camera = stage.camera
    assert camera.fx == camera.fy, "Mitsuba's pixels are square"
    film = {
        "type": "hdrfilm",
        "width": camera.width,
        "height": camera.height,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
        "component_format": "float32",
    }
    # Mitsuba's cameras look along +z with x to the left
    turned = pose(stage.pose.pos, stage.pose.mat) @ np.diag([-1.0, 1.0, -1.0, 1.0])
    common = {"film": film, "sampler": {"type": "independent"}}
    half = camera.width / 2 / camera.fx
    if camera.orthographic:
        assert (camera.cx, camera.cy) == (camera.width / 2, camera.height / 2)
        return common | {"type": "orthographic", "to_world": scaled(turned, [half, half, 1])}
    return common | {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f(turned),
        "fov_axis": "x",
        "fov": float(np.rad2deg(2 * np.arctan(half))),
        "principal_point_offset_x": 0.5 - camera.cx / camera.width,
        "principal_point_offset_y": 0.5 - camera.cy / camera.height,
        "near_clip": 1e-3,
        "far_clip": 1e5,
    }


def _geom(stage: Stage, index: int, shape: Shape) -> list[Any]:
    """Mitsuba's shapes that make up one geom."""
    scene = stage.scene
    frame = pose(stage.shot.geom_pos[index], stage.shot.geom_mat[index])
    size = [float(s) for s in scene.geom_size[index]]
    surface = scene.surfaces[scene.geom_surface[index]]
    glow: dict[str, Any] = {}
    if surface.emission > 0:
        assert surface.texture < 0
        radiance = surface.emission * linear(surface.rgba[:3])
        glow = {"emitter": {"type": "area", "radiance": rgb(radiance)}}
    mesh = None
    if shape is Shape.ELLIPSOID:
        mesh = ball(200, size)
    elif shape is Shape.MESH:
        mesh = scene.meshes[scene.geom_mesh[index]]
    look = {"bsdf": bsdf(stage, surface, shape)} | glow
    return [_mesh(mesh, frame, look)] if mesh else _parts(shape, size, frame, look)


def _parts(shape: Shape, size: list[float], frame: F64, look: dict[str, Any]) -> list[Any]:
    """A primitive, made of one or more of Mitsuba's shapes."""

    def at(z: float) -> list[float]:
        return [float(v) for v in (frame @ [0, 0, z, 1])[:3]]

    radius, half = size[0], size[1]
    if shape is Shape.PLANE:
        sides = [side if side > 0 else FAR for side in size[:2]]
        return [{"type": "rectangle", "to_world": scaled(frame, [*sides, 1])} | look]
    if shape is Shape.SPHERE:
        return [{"type": "sphere", "center": at(0), "radius": radius} | look]
    if shape is Shape.BOX:
        return [{"type": "cube", "to_world": scaled(frame, size)} | look]
    barrel = {"type": "cylinder", "radius": radius, "p0": at(-half), "p1": at(half)} | look
    if shape is Shape.CYLINDER:
        lids = [
            {"type": "disk", "to_world": scaled(frame @ pose([0, 0, z], turn), [radius, radius, 1])}
            | look
            for z, turn in ((half, np.eye(3)), (-half, np.diag([1.0, -1.0, -1.0])))
        ]
        return [barrel, *lids]
    # the inner halves of a capsule's balls cannot be seen, but they would glow
    assert shape is Shape.CAPSULE
    assert "emitter" not in look
    ends = [{"type": "sphere", "center": at(z), "radius": radius} | look for z in (-half, half)]
    return [barrel, *ends]


def _mesh(mesh: Mesh, frame: F64, look: dict[str, Any]) -> Any:
    """A mesh whose faces share no corners, because our normals and coordinates belong to faces."""
    props = mi.Properties()
    for key, value in look.items():
        props[key] = mi.load_dict(value)
    count = len(mesh.faces)
    made = mi.Mesh(
        "mesh",
        3 * count,
        count,
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.texcoords is not None,
        props=props,
    )
    params = mi.traverse(made)
    corners = mesh.vertices[mesh.faces].reshape(-1, 3) @ frame[:3, :3].T + frame[:3, 3]
    params["vertex_positions"] = corners.ravel()
    params["faces"] = np.arange(3 * count, dtype=np.uint32)
    if mesh.normals is not None:
        params["vertex_normals"] = (mesh.normals.reshape(-1, 3) @ frame[:3, :3].T).ravel()
    if mesh.texcoords is not None:
        params["vertex_texcoords"] = mesh.texcoords.ravel()
    params.update()
    return made


def bsdf(stage: Stage, surface: Surface, shape: Shape) -> dict[str, Any]:
    """A material: a share that mirrors, a glossy share without Fresnel, and the rest Lambert."""
    # a mirror takes nothing from the rest of a classic material, so the blend below may not either
    beside = 1 - surface.reflectance if surface.roughness < 0 else 1.0
    albedo = rgb(linear(surface.rgba[:3]) / beside)
    if surface.texture >= 0:
        assert beside == 1
        albedo = _texture(stage, surface, shape)
    look: dict[str, Any] = {"type": "diffuse", "reflectance": albedo}
    shine = {"type": "roughconductor", "material": "none", "distribution": "ggx"}
    if stage.path and surface.roughness >= 0:
        # a physical material: the dielectric's 4 % or the metal's colour, and the rest
        colour, metallic = linear(surface.rgba[:3]), max(surface.metallic, 0.0)
        gloss = 0.04 + (colour - 0.04) * metallic
        share = float(gloss.max())
        rest = colour * (1 - metallic) * (1 - gloss) / (1 - share)
        assert (rest <= 1).all()
        shine |= {"alpha": surface.roughness**2, "specular_reflectance": rgb(gloss / share)}
        look = _blend(share, {"type": "diffuse", "reflectance": rgb(rest)}, shine)
    elif stage.path and surface.specular > 0:
        # the lobe of a Blinn-Phong exponent; specular 0.5 reflects like most dielectrics
        width = np.sqrt(2 / (128 * surface.shininess + 2))
        assert beside == 1
        assert surface.texture < 0  # which would colour the lobe
        look = _blend(0.08 * surface.specular, look, shine | {"alpha": float(width)})
    if surface.reflectance > 0:
        mirror = {"type": "conductor", "material": "none"}
        look = _blend(_mosaic(surface.reflectance), look, mirror)
    if surface.rgba[3] < 1:
        look = {"type": "mask", "opacity": surface.rgba[3], "bsdf": look}
    return look


def _mosaic(share: float) -> dict[str, Any]:
    """A pattern far finer than a pixel, in which this share, in tenths, is 1 and the rest 0.

    Mitsuba's blend of a perfect mirror and another surface is wrong (3.9: it adds densities of
    different kinds), except where the blend is all of one or all of the other.
    """
    tenths = round(10 * share)
    assert abs(10 * share - tenths) < 1e-9
    latin = (np.add.outer(np.arange(10), 3 * np.arange(10)) % 10 < tenths).astype(np.float32)
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(latin[..., np.newaxis])),
        "raw": True,
        "filter_type": "nearest",
        "to_uv": mi.ScalarTransform4f(np.diag([2000.0, 2000.0, 1.0, 1.0])),
    }


def _blend(weight: Any, first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    return {"type": "blendbsdf", "weight": weight, "first": first, "second": second}


def _texture(stage: Stage, surface: Surface, shape: Shape) -> dict[str, Any]:
    texture = stage.scene.textures[surface.texture]
    assert texture.kind is TextureKind.FLAT
    assert not surface.texuniform
    data = texture.data[..., :3] / 255.0
    data = (linear(data) if texture.srgb else data) * linear(surface.rgba[:3])
    repeat_u, repeat_v = surface.texrepeat
    # on a plane Mitsuba counts v from below, and we from above; a mesh has coordinates of its own
    to_uv = np.diag([repeat_u, repeat_v, 1.0, 1.0])
    if shape is Shape.PLANE:
        to_uv[1, 1], to_uv[1, 3] = -repeat_v, repeat_v
    else:
        assert shape is Shape.MESH
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(
            np.ascontiguousarray(np.broadcast_to(data, (*data.shape[:2], 3)), np.float32)
        ),
        "raw": True,
        "filter_type": "bilinear",
        "to_uv": mi.ScalarTransform4f(to_uv),
    }


def _light(stage: Stage, index: int, light: Light) -> dict[str, Any]:
    assert not light.headlight
    assert light.castshadow
    place, along = stage.shot.light_pos[index], stage.shot.light_dir[index]
    strength = np.pi * np.asarray(light.diffuse, np.float64)
    if light.kind is LightKind.DIRECTIONAL:
        return {
            "type": "directional",
            "direction": [float(v) for v in along],
            "irradiance": rgb(strength),
        }
    # the light fades with the square of the distance
    assert light.intensity > 0 or light.attenuation == (0.0, 0.0, 1.0)
    if light.intensity > 0:
        strength = strength * (light.intensity / stage.render.lux_per_unit)
    position = [float(v) for v in place]
    if stage.path and light.bulbradius_m > 0:
        assert light.kind is LightKind.POINT
        radius = light.bulbradius_m
        glow = {"type": "area", "radiance": rgb(strength / (np.pi * radius**2))}
        return {"type": "sphere", "center": position, "radius": radius, "emitter": glow}
    if light.kind is LightKind.POINT:
        return {"type": "point", "position": position, "intensity": rgb(strength)}
    # the strength is uniform inside the cone, and zero outside
    assert light.exponent == 0
    return {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(
            position, [float(v) for v in place + along], _across(along)
        ),
        "intensity": rgb(strength),
        "cutoff_angle": light.cutoff_deg,
        "beam_width": light.cutoff_deg * (1 - 1e-6),
    }


def _across(direction: F64) -> list[float]:
    """A direction that is not parallel to the given one."""
    return [float(v) for v in np.eye(3)[np.argmin(np.abs(direction))]]


def _sky(stage: Stage, dome: F64) -> dict[str, Any]:
    """The skybox and the uniform dome as one latitude-longitude picture."""
    height = 512
    # Mitsuba's y is up in the picture: u turns around it from -z to +x. The first and last rows
    # are the poles; the columns are sampled at their centres
    tall, around = np.meshgrid(
        np.linspace(0, np.pi, height),
        (np.arange(2 * height) + 0.5) / height * np.pi,
        indexing="ij",
    )
    local = np.stack(
        [np.sin(around) * np.sin(tall), np.cos(tall), -np.cos(around) * np.sin(tall)], -1
    )
    # (x, y, z) of the picture is (x, z, -y) of the world
    world = local @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
    picture = stage.sky_radiance(world) + dome
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(picture.astype(np.float32)),
        "to_world": mi.ScalarTransform4f(
            np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)
        ),
    }
