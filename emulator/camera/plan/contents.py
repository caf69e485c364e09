"""What a scene contains, counted: all that decides which code paths it needs."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from evs.emulator.base.scene import Light, LightKind, ObjectKind, SceneModel, Shape
from evs.emulator.config import RenderConfig


@dataclass(frozen=True)
class Contents:
    """Counts of what can be seen, by kind; 0 and empty where there is none."""

    geoms: dict[str, int]
    """by shape: plane, box, mesh, ..."""
    meshes: int
    triangles: int
    height_fields: int
    deforming: int
    """skins and flexes with faces"""
    sites: int
    """that are seen"""
    tendons: int
    ropes: int
    """flexes of dimension 1"""
    slider_cranks: int
    rods: int
    """of tendons, ropes and slider-cranks, some of which may not be seen now"""
    geoms_moving: int
    geoms_still: int
    lights: dict[str, int]
    """by kind: headlight, directional, point, spot, image"""
    casting: int
    """lights that cast shadows"""
    coloured: tuple[str, ...]
    """names of the lights that are not grey"""
    bulbs: int
    """lights with a radius, which `path` sees as balls"""
    surfaces: int
    textured: int
    """surfaces with an image"""
    physical: int
    """surfaces with metallic, roughness or any map"""
    bumpy: int
    """surfaces with a normal map"""
    mirrors: int
    """surfaces that may mirror: opaque, with reflectance, on planes and boxes"""
    not_mirrors: int
    """geoms whose material has reflectance, of shapes that do not mirror"""
    transparent: int
    glowing: int
    textures: int
    texels: int
    planes: int
    endless_planes: int
    sky: bool
    fog: bool
    """it is asked for, and the model has it"""
    haze: bool
    """it is asked for, and the model has a sky and a plane without bounds"""
    flickering: int
    """tables of lights that pulse"""
    unlit: bool
    """neither a light nor a glowing surface is left"""


def contents_of(scene: SceneModel, render: RenderConfig) -> Contents:
    """Of a scene with the lights, the atmosphere and the sites that [render] leaves it."""
    scene = scene if render.sites else scene.without_sites()
    things = scene.geom_kind
    if not len(things):
        things = np.full(len(scene.geom_type), ObjectKind.GEOM)
    solid, seen_sites = (
        things < ObjectKind.SITE,
        (things == ObjectKind.SITE) & (scene.geom_size[:, 0] > 0),
    )
    shapes = Counter(Shape(int(shape)).name.lower() for shape in scene.geom_type[solid])
    lights = [x for x in scene.lights if render.headlight == "model" or not x.headlight]
    there = solid | seen_sites | (things > ObjectKind.SITE)
    used = [scene.surfaces[index] for index in sorted(set(scene.geom_surface[there].tolist()))]
    planes = scene.geom_type == Shape.PLANE
    endless = planes & (scene.geom_size[:, 0] <= 0) & (scene.geom_size[:, 1] <= 0)
    kinds = Counter("headlight" if x.headlight else x.kind.name.lower() for x in lights)
    triangles = [len(mesh.faces) for mesh in scene.meshes]
    seen = scene.geom_mesh[scene.geom_mesh >= 0]
    maps = ("metallic", "roughness", "occlusion", "opacity", "normal", "emissive")
    atmosphere = scene.atmosphere
    return Contents(
        geoms=dict(sorted(shapes.items())),
        meshes=len(scene.meshes) - len(scene.deforming) - shapes["hfield"],
        triangles=int(sum(triangles[int(mesh)] for mesh in seen)),
        height_fields=shapes["hfield"],
        deforming=len(scene.deforming),
        sites=int(seen_sites.sum()),
        tendons=len(set(scene.geom_id[things == ObjectKind.TENDON].tolist())),
        ropes=len(set(scene.geom_id[things == ObjectKind.ROPE].tolist())),
        slider_cranks=len(set(scene.geom_id[things == ObjectKind.CRANK].tolist())),
        rods=len(scene.stretching),
        geoms_moving=int((solid & ~scene.geom_static).sum()),
        geoms_still=int((solid & scene.geom_static).sum()),
        lights=dict(sorted(kinds.items())),
        casting=sum(x.castshadow and x.kind is not LightKind.IMAGE for x in lights),
        coloured=tuple(x.name for x in lights if not _is_grey(scene, x)),
        bulbs=sum(
            x.bulbradius_m > 0 and x.kind in (LightKind.SPOT, LightKind.POINT) for x in lights
        ),
        surfaces=len(used),
        textured=sum(surface.texture >= 0 for surface in used),
        physical=sum(
            surface.metallic >= 0
            or surface.roughness >= 0
            or any(getattr(surface, f"{name}_map") >= 0 for name in maps)
            for surface in used
        ),
        bumpy=sum(surface.normal_map >= 0 for surface in used),
        mirrors=sum(surface.reflectance > 0 and surface.rgba[3] >= 1 for surface in used),
        not_mirrors=scene.not_mirrors,
        transparent=sum(surface.rgba[3] < 1 or surface.opacity_map >= 0 for surface in used),
        glowing=sum(surface.emission > 0 or surface.emissive_map >= 0 for surface in used),
        textures=len(scene.textures),
        texels=sum(int(np.prod(texture.data.shape[:-1])) for texture in scene.textures),
        planes=int(planes.sum()),
        endless_planes=int(endless.sum()),
        sky=scene.skybox >= 0,
        fog=atmosphere is not None and render.fog,
        haze=atmosphere is not None
        and render.haze
        and atmosphere.haze_radius_m > 0
        and atmosphere.haze_ratio > 0
        and bool(endless.any()),
        flickering=len(render.flicker),
        unlit=is_unlit(scene, render),
    )


def is_unlit(scene: SceneModel, render: RenderConfig) -> bool:
    """Whether neither a light nor a glowing surface is left; a sky lights nothing."""
    scene = scene if render.sites else scene.without_sites()
    for light in scene.lights:
        colours = (*light.ambient, *light.diffuse, *light.specular, light.intensity)
        if any(colours) and (render.headlight == "model" or not light.headlight):
            return False
    return not any(
        surface.emission > 0.0 or surface.emissive_map >= 0 for surface in scene.surfaces
    )


def _is_grey(scene: SceneModel, light: Light) -> bool:
    colours = (light.ambient, light.diffuse, light.specular)
    if any(np.unique(np.array(colour, np.float32)).size > 1 for colour in colours):
        return False
    if light.kind is not LightKind.IMAGE:
        return True
    image = scene.textures[light.texture].data
    return image.shape[-1] < 3 or bool(np.all(image[..., :3] == image[..., :1]))
