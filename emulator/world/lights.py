"""A model's lights as MuJoCo's own pictures have them: headlight first, then the active ones."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from evs.emulator.scene import I32, Air, Light, LightKind, Texture, TextureKind
from evs.emulator.world.bounds import BRIGHTEST, bounded, bounded_colour
from evs.emulator.world.names import name_of
from evs.emulator.world.surfaces import Surfaces, extract_texture

HAZE_DISTANCE = 0.7
"""Of the far clipping plane: where MuJoCo's viewer draws sky and haze."""


def active_lights(model: mujoco.MjModel) -> I32:
    """(nl,) ids of the lights that shine; -1 is the headlight.

    An image light whose image is not a cube that we can read (KTX, HDR) is left out.
    """
    chosen = [
        light
        for light in range(model.nlight)
        if model.light_active[light] and _has_image(model, light)
    ]
    return np.array([-1] * bool(model.vis.headlight.active) + chosen, np.int32)


def extract_light(model: mujoco.MjModel, light: int, surfaces: Surfaces) -> Light:
    """One light by its id; -1 is the headlight. `surfaces` keeps the image of an image light."""
    if light < 0:
        head = model.vis.headlight
        return Light(
            LightKind.DIRECTIONAL,
            bounded_colour(head.ambient, BRIGHTEST, "ambient of the headlight"),
            bounded_colour(head.diffuse, BRIGHTEST, "diffuse of the headlight"),
            bounded_colour(head.specular, BRIGHTEST, "specular of the headlight"),
            castshadow=False,
            headlight=True,
            name="headlight",
        )
    name = name_of(model, mujoco.mjtObj.mjOBJ_LIGHT, light)

    def number(attribute: str, low: float, high: float) -> float:
        value = getattr(model, f"light_{attribute}")[light]
        return bounded(value, low, high, f"{attribute} of light '{name}'")

    def colour(attribute: str) -> tuple[float, float, float]:
        values = getattr(model, f"light_{attribute}")[light]
        return bounded_colour(values, BRIGHTEST, f"{attribute} of light '{name}'")

    kind = LightKind(int(model.light_type[light]))
    image = int(model.light_texid[light]) if kind is LightKind.IMAGE else -1
    common = Light(
        kind,
        colour("ambient"),
        colour("diffuse"),
        colour("specular"),
        castshadow=bool(model.light_castshadow[light]),
        intensity=number("intensity", 0.0, BRIGHTEST),
        range_m=number("range", 0.0, 1e9),
        bulbradius_m=number("bulbradius", 0.0, 1e9),
        texture=surfaces.texture(image),
        name=name,
    )
    if kind is not LightKind.SPOT:
        return common

    # only spots fade with distance and angle
    return replace(
        common,
        attenuation=colour("attenuation"),
        cutoff_deg=number("cutoff", 0.0, 180.0),
        exponent=number("exponent", 0.0, 1e9),
        softness=number("softness", 0.0, 1.0),
    )


def extract_air(model: mujoco.MjModel) -> Air:
    """Fog, and the haze that MuJoCo's viewer shows where a sky meets a plane without bounds."""
    extent_m, view, rgba = float(model.stat.extent), model.vis.map, model.vis.rgba
    has_sky = mujoco.mjtTexture.mjTEXTURE_SKYBOX in model.tex_type
    haze_m = HAZE_DISTANCE * view.zfar * extent_m if has_sky else 0.0
    return Air(
        fog_start_m=bounded(extent_m * view.fogstart, -1e12, 1e12, "visual/map fogstart"),
        fog_end_m=bounded(extent_m * view.fogend, -1e12, 1e12, "visual/map fogend"),
        fog_rgb=bounded_colour(rgba.fog[:3], 1.0, "visual/rgba fog"),
        haze_ratio=bounded(view.haze, 0.0, 1.0, "visual/map haze"),
        haze_radius_m=bounded(haze_m, 0.0, 1e12, "visual/map zfar"),
        haze_rgb=bounded_colour(rgba.haze[:3], 1.0, "visual/rgba haze"),
    )


def _has_image(model: mujoco.MjModel, light: int) -> bool:
    """Whether a light needs no image, or has one."""
    if model.light_type[light] != mujoco.mjtLightType.mjLIGHT_IMAGE:
        return True
    index = int(model.light_texid[light])
    image: Texture | None = extract_texture(model, index) if index >= 0 else None
    return image is not None and image.kind is not TextureKind.FLAT
