"""The scene plan: what a scene contains, and which code paths are on or off and why.

The decision about a code path is made where the code path is, and read from there: a reason here
explains it. `evs plan --measure` measures what a tick costs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from evs.emulator.base.features import FEATURES, Feature, Switches
from evs.emulator.base.scene import Light, ObjectKind, SceneModel, Shape
from evs.emulator.config import ModelConfig, RenderConfig, RunConfig
from evs.emulator.render.renderer_table import RENDERERS
from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.terms import TERMS
from evs.emulator.world import BoundCamera, MjModel, Mobility, mobility_of

FORCED_ON = "[plan] has it on, whether the scene needs it or not"
FORCED_OFF = "[plan] leaves it out, whether the scene needs it or not"
CANNOT = "[plan] asks for it, but it has no place here"

SCANNED = 128
"""geoms that rays test one by one; there is a hierarchy of more"""

PACKET_SIDE = 4
"""of a packet of rays, which are traced together, px"""


@dataclass(frozen=True)
class Decision:
    """One code path."""

    feature: Feature
    on: bool
    why: str
    forced: bool
    """whether [plan] has decided it, and not the scene"""


@dataclass(frozen=True)
class ScenePlan:
    """What one camera's scene requires."""

    contents: Contents
    mobility: Mobility
    view: dict[str, Any]
    """pixels, projection, renderer, samples: what is requested of them; the rays of a tick in which
    every pixel is traced, those to lights at most"""
    decisions: tuple[Decision, ...]
    """of the code paths that the renderer and the event model know, in the order of the stages"""

    def compact(self) -> dict[str, Any]:
        """For reports: contents without what there is none of, names that are on, why off."""
        has = {key: value for key, value in asdict(self.contents).items() if value}
        moves = {key: value for key, value in asdict(self.mobility).items() if value}
        return {
            "contents": {**has, **moves},
            "view": self.view,
            "on": [each.feature.name for each in self.decisions if each.on],
            "off": {each.feature.name: each.why for each in self.decisions if not each.on},
            "forced": [each.feature.name for each in self.decisions if each.forced],
        }


def plan_scene(
    world: MjModel,
    scene: SceneModel,
    bound: BoundCamera,
    sensor: SensorParameters,
    config: RunConfig,
    switches: Switches,
    features: Mapping[str, bool],
) -> ScenePlan:
    """Make the plan of a camera.

    Args:
        world: The model.
        scene: What is extracted from it.
        bound: The camera.
        sensor: The sensor, resolved.
        config: Everything that makes the camera.
        switches: Code paths that are forced on or off.
        features: Which code paths it runs.
    """
    render, model = config.render, config.model
    has, mobility = contents_of(scene, render), mobility_of(world, bound)
    why = reasons(has, mobility, sensor, render, model)
    decisions = []
    for feature in FEATURES:
        if feature.name not in features:
            continue
        on = features[feature.name]
        forced = feature.name in (switches.on if on else switches.off)
        reason = why[feature.name].on if on else why[feature.name].off
        if forced:
            reason = FORCED_ON if on else FORCED_OFF
        elif feature.name in switches.on:
            reason = CANNOT
        decisions.append(Decision(feature, on, reason, forced))
    render = render.for_scene(scene.has_meshes)
    view = _view(bound, render, model.name)
    if RENDERERS[render.renderer].traced:
        packets = -(-view["width"] // PACKET_SIDE) * -(-view["height"] // PACKET_SIDE)
        view["camera_rays"] = packets * PACKET_SIDE**2 * render.samples
        view["shadow_rays"] = view["camera_rays"] * has.casting * features.get("shadows", False)
    return ScenePlan(has, mobility, view, tuple(decisions))


def _view(bound: BoundCamera, render: RenderConfig, model: str) -> dict[str, Any]:
    """Optics, renderer and model of a view."""
    camera = bound.model
    view = {
        "width": camera.width,
        "height": camera.height,
        "projection": "orthographic" if camera.orthographic else "perspective",
        "distortion_model": camera.distortion_model,
        "renderer": render.renderer,
        "samples": render.samples,
        "antialiasing": "adaptive" if render.adaptive else "fixed",
        "model": model,
    }
    if RENDERERS[render.renderer].bounces:
        view["bounces"] = render.bounces
    if render.seeds == "cycle":
        view["cycle_ticks"] = render.cycle_ticks
    return view


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
    bounded: int
    """lights with a cone or a range"""
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
    """neither a light nor a glowing surface is left, nor a sky that shines"""
    seen: str = ""
    """groups of geoms, sites, ... that are seen, and flags that are not the usual ones"""
    hidden_geoms: tuple[str, ...] = ()
    """one line for each group with geoms that these hide"""


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
        casting=sum(x.castshadow and not x.is_image for x in lights),
        coloured=tuple(x.name for x in lights if not _is_grey(scene, x)),
        bounded=sum(x.is_bounded for x in lights),
        bulbs=sum(x.bulbradius_m > 0 and x.is_local for x in lights),
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
        seen=scene.seen,
        hidden_geoms=scene.hidden,
    )


def is_unlit(scene: SceneModel, render: RenderConfig) -> bool:
    """Whether neither a light nor a glowing surface is left, nor a sky that shines."""
    if sky_shines(scene.skybox >= 0, render):
        return False
    scene = scene if render.sites else scene.without_sites()
    for light in scene.lights:
        colours = (*light.ambient, *light.diffuse, *light.specular, light.intensity)
        if any(colours) and (render.headlight == "model" or not light.headlight):
            return False
    return not any(
        surface.emission > 0.0 or surface.emissive_map >= 0 for surface in scene.surfaces
    )


def sky_shines(sky: bool, render: RenderConfig) -> bool:
    """Whether a sky, if there is one, lights the scene."""
    return sky and render.sky == "light" and bool(RENDERERS[render.renderer].bounces)


def _is_grey(scene: SceneModel, light: Light) -> bool:
    colours = (light.ambient, light.diffuse, light.specular)
    if any(np.ptp(np.array(colour, np.float32)) > 0 for colour in colours):
        return False
    if not light.is_image:
        return True
    image = scene.textures[light.texture].data
    return image.shape[-1] < 3 or bool(np.all(image[..., :3] == image[..., :1]))


@dataclass(frozen=True)
class Why:
    """Both reasons of a code path; the one that does not hold is never shown."""

    on: str
    off: str


def reasons(
    has: Contents,
    mobility: Mobility,
    sensor: SensorParameters,
    render: RenderConfig,
    model: ModelConfig,
) -> dict[str, Why]:
    """Name of each code path -> why it is on, or off, from what the scene contains."""
    return {
        **_surfaces(has, render),
        **_air(has, render),
        **_light(has, mobility, render),
        **_sensor(sensor),
        **_beside(sensor, model),
    }


def _surfaces(has: Contents, render: RenderConfig) -> dict[str, Why]:
    path = RENDERERS[render.renderer].bounces
    of_paths = "only renderers hybrid and path have it"
    lobes = (
        f"{render.renderer} sees every gloss as a GGX lobe"
        if path
        else f"materials that ask for it: {has.physical}"
    )
    return {
        "physical_gloss": Why(lobes, "no material is physical or has maps"),
        "normal_maps": Why(f"materials that have one: {has.bumpy}", "no material has a normal map"),
        "texture_filter": Why("surfaces have images or maps", "no surface has an image or a map"),
        "outlines": Why(
            "shapes that are not meshes", "path, a lens or no such shape: outlines are sampled"
        ),
        "glowing": Why(
            f"surfaces that glow: {has.glowing}", "no surface glows" if path else of_paths
        ),
        "transparent": Why(
            f"surfaces that are: {has.transparent}",
            "no surface is transparent" if path else f"{of_paths}: direct decides for each pixel",
        ),
        "refits": Why(
            "a skin or flex changed its shape",
            "no skins or flexes move" if has.deforming else "the scene has no skins or flexes",
        ),
    }


def _air(has: Contents, render: RenderConfig) -> dict[str, Why]:
    without = "no infinite plane" if has.sky else "no sky"
    haze = "render.haze=false" if not render.haze else f"there is {without} and so no horizon"
    if has.haze:
        haze = "the camera sees no horizon"
    sky = "render.sky=light" if sky_shines(has.sky, render) else "a backdrop, which lights nothing"
    return {
        "sky": Why(f"the model has a sky: {sky}", "the model has no sky"),
        "fog": Why("render.fog=true", "render.fog=false"),
        "haze": Why("a sky and an infinite plane", haze),
    }


def _light(has: Contents, mobility: Mobility, render: RenderConfig) -> dict[str, Why]:
    row = RENDERERS[render.renderer]
    coloured = ", ".join(has.coloured[:3])
    geoms = sum(has.geoms.values())
    bent = "camera.distortion_model"
    retrace = "render.incremental=false" if row.traced else "OpenGL draws it"
    kept = f"{'samples' if row.paths else 'pixels'} that no motion can affect are kept"
    if row.caches_light:
        kept = "pixels that no motion can affect only read the cache"
    if mobility.camera_moves:
        kept += f", while the camera rests ({mobility.camera_moves})"
    return {
        "colour": Why(
            "light travels from surface to surface"
            if row.paths
            else f"lights not grey: {coloured}",
            "every light is grey: luminance is enough",
        ),
        "shadows": Why(
            f"lights that cast them: {has.casting}",
            "render.shadows=false" if not render.shadows else "no light casts any",
        ),
        "plane_shadows": Why(
            "a light is behind a plane",
            f"the lights are on the front of every plane ({has.planes})"
            if has.planes
            else "there is no plane",
        ),
        "hierarchy": Why(f"geoms: {geoms}", f"geoms: {geoms}; it needs {SCANNED + 1} to 65,536"),
        "light_reach": Why(
            f"lights with a cone or a range: {has.bounded}",
            f"too few lights with a cone or a range: {has.bounded}",
        ),
        "cached_light": Why(
            "up to 96 ticks old; gloss reflects what a diffuse surface would; lamps are points",
            "only renderer hybrid has it",
        ),
        "light_gains": Why("[[render.flicker]]", "no light flickers"),
        "lens": Why(bent, f"{bent}=none: a pinhole"),
        "vignetting": Why("camera.vignetting", "camera.vignetting=none"),
        "full_retrace": Why(retrace, kept),
    }


def _sensor(sensor: SensorParameters) -> dict[str, Why]:
    """The parameters that need each term."""

    def values(keys: tuple[str, ...]) -> str:
        return ", ".join(f"sensor.{key}={getattr(sensor, key):g}" for key in keys)

    return {name: Why(values(keys), values(keys)) for name, keys in TERMS.items()}


def _readout(sensor: SensorParameters) -> str:
    """The stages between pixel and packet that the sensor has."""
    readout = sensor.readout
    stages = {
        "a latency of the pixels": sensor.latency_us > 0 or sensor.latency_sigma_us > 0,
        f"rows read by {readout.order}": readout.order != "ideal",
        f"event rate control at {readout.erc_rate_mevs:g} Mev/s": readout.erc_rate_mevs > 0,
        f"a link of {readout.bandwidth_mevs:g} Mev/s": readout.bandwidth_mevs > 0,
        "a region of interest": bool(readout.roi),
        "masked pixels": bool(readout.mask or readout.mask_file),
    }
    return ", ".join(stage for stage, there in stages.items() if there)


def _beside(sensor: SensorParameters, model: ModelConfig) -> dict[str, Why]:
    labels = "model.labels=true"
    return {
        "ground_truth": Why(labels, "traced when a subscriber requests it"),
        "causes": Why(labels, "model.labels=false"),
        "running_mean": Why(f"model {model.name}", f"model {model.name}"),
        "cold_tiles": Why(
            "the network has a bias" if model.runtime == "native" else f"runtime {model.runtime}",
            "tiles in which nothing moves are skipped",
        ),
        "readout": Why(_readout(sensor), "every event passes at its own time"),
        "aps": Why("sensor.aps.enabled=true", "sensor.aps.enabled=false"),
        "imu": Why("sensor.imu.enabled=true", "sensor.imu.enabled=false"),
    }
