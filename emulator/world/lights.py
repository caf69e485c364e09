"""A model's lights as MuJoCo's own pictures have them: headlight first, then the active ones."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from evs.emulator.base.scene import I32, Atmosphere, Light, LightKind
from evs.emulator.world.compat import light_number, light_type
from evs.emulator.world.materials import BRIGHTEST, Surfaces, clamped, clamped_colour, is_encoded
from evs.emulator.world.model import name_of

SIX_FACES = 'type="cube" or type="skybox"'
"""What the texture of an image light has to have."""

HAZE_DISTANCE = 0.7
"""Of the far clipping plane: where MuJoCo's viewer draws sky and haze."""


def active_lights(model: mujoco.MjModel) -> I32:
    """(nl,) ids of the lights that shine; -1 is the headlight.

    An image light without a cube image that we can read is left out: see unlit_images.
    """
    chosen = [
        light
        for light in range(model.nlight)
        if model.light_active[light] and not _image_problem(model, light)
    ]
    return np.array([-1] * bool(model.vis.headlight.active) + chosen, np.int32)


def unlit_images(model: mujoco.MjModel) -> list[str]:
    """One line for each image light that is left out: its name, the reason, the fix."""
    return [
        f"light '{name_of(model, mujoco.mjtObj.mjOBJ_LIGHT, light)}' is left out: {problem}"
        for light in range(model.nlight)
        if model.light_active[light] and (problem := _image_problem(model, light))
    ]


def extract_light(model: mujoco.MjModel, light: int, surfaces: Surfaces) -> Light:
    """One light by its id; -1 is the headlight. `surfaces` keeps the image of an image light."""
    if light < 0:
        head = model.vis.headlight
        return Light(
            LightKind.DIRECTIONAL,
            clamped_colour(head.ambient, BRIGHTEST, "ambient of the headlight"),
            clamped_colour(head.diffuse, BRIGHTEST, "diffuse of the headlight"),
            clamped_colour(head.specular, BRIGHTEST, "specular of the headlight"),
            castshadow=False,
            headlight=True,
            name="headlight",
        )
    name = name_of(model, mujoco.mjtObj.mjOBJ_LIGHT, light)

    def number(attribute: str, low: float, high: float) -> float:
        value = light_number(model, attribute, light)
        return clamped(value, low, high, f"{attribute} of light '{name}'")

    def colour(attribute: str) -> tuple[float, float, float]:
        values = getattr(model, f"light_{attribute}")[light]
        return clamped_colour(values, BRIGHTEST, f"{attribute} of light '{name}'")

    common = Light(
        LightKind(light_type(model, light)),
        colour("ambient"),
        colour("diffuse"),
        colour("specular"),
        castshadow=bool(model.light_castshadow[light]),
        intensity=number("intensity", 0.0, BRIGHTEST),
        range_m=number("range", 0.0, 1e9),
        bulbradius_m=number("bulbradius", 0.0, 1e9),
        name=name,
    )
    if common.is_image:
        return replace(common, texture=surfaces.texture(int(model.light_texid[light])))
    if not common.is_local:
        return common
    common = replace(common, attenuation=colour("attenuation"))
    if not common.has_cone:
        return common
    return replace(
        common,
        cutoff_deg=number("cutoff", 0.0, 180.0),
        exponent=number("exponent", 0.0, 1e9),
        softness=number("softness", 0.0, 1.0),
    )


def extract_atmosphere(model: mujoco.MjModel) -> Atmosphere:
    """Fog, and the haze that MuJoCo's viewer shows where a sky meets a plane without bounds."""
    extent_m, view, rgba = float(model.stat.extent), model.vis.map, model.vis.rgba
    has_sky = mujoco.mjtTexture.mjTEXTURE_SKYBOX in model.tex_type
    haze_m = HAZE_DISTANCE * view.zfar * extent_m if has_sky else 0.0
    return Atmosphere(
        fog_start_m=clamped(extent_m * view.fogstart, -1e12, 1e12, "visual/map fogstart"),
        fog_end_m=clamped(extent_m * view.fogend, -1e12, 1e12, "visual/map fogend"),
        fog_rgb=clamped_colour(rgba.fog[:3], 1.0, "visual/rgba fog"),
        haze_ratio=clamped(view.haze, 0.0, 1.0, "visual/map haze"),
        haze_radius_m=clamped(haze_m, 0.0, 1e12, "visual/map zfar"),
        haze_rgb=clamped_colour(rgba.haze[:3], 1.0, "visual/rgba haze"),
    )


def _image_problem(model: mujoco.MjModel, light: int) -> str:
    """Why an image light cannot shine, and what would help; "" for every other light."""
    if light_type(model, light) != LightKind.IMAGE:
        return ""
    index = int(model.light_texid[light])
    if index < 0:
        return f"an image light has a texture; give it one with {SIX_FACES}"
    name = name_of(model, mujoco.mjtObj.mjOBJ_TEXTURE, index)
    if is_encoded(model, index):
        return (
            f"its texture '{name}' is a KTX file, which is not read; give it one of PNG with "
            f"{SIX_FACES}"
        )
    if model.tex_type[index] == mujoco.mjtTexture.mjTEXTURE_2D:
        return f"its texture '{name}' is flat; give it one with {SIX_FACES}"
    return ""
