"""A model's lights as MuJoCo's own pictures have them: headlight first, then the active ones."""

from __future__ import annotations

import mujoco
import numpy as np

from evs.emulator.scene import I32, Light, LightKind


def active_lights(model: mujoco.MjModel) -> I32:
    """(nl,) ids of the lights that shine; -1 is the headlight. Image lights are left out."""
    kinds = {int(kind) for kind in LightKind}
    chosen = [
        light
        for light in range(model.nlight)
        if model.light_active[light] and int(model.light_type[light]) in kinds
    ]
    return np.array([-1] * bool(model.vis.headlight.active) + chosen, np.int32)


def extract_light(model: mujoco.MjModel, light: int) -> Light:
    """One light by its id; -1 is the headlight."""
    if light < 0:
        head = model.vis.headlight
        return Light(
            LightKind.DIRECTIONAL,
            _colour(head.ambient),
            _colour(head.diffuse),
            _colour(head.specular),
            castshadow=False,
            headlight=True,
        )
    kind = LightKind(int(model.light_type[light]))
    common = Light(
        kind,
        _colour(model.light_ambient[light]),
        _colour(model.light_diffuse[light]),
        _colour(model.light_specular[light]),
        castshadow=bool(model.light_castshadow[light]),
        intensity=float(model.light_intensity[light]),
        range_m=float(model.light_range[light]),
        bulbradius_m=float(model.light_bulbradius[light]),
    )
    if kind is not LightKind.SPOT:
        return common

    # only spots fade with distance and angle
    return Light(
        kind,
        common.ambient,
        common.diffuse,
        common.specular,
        common.castshadow,
        _colour(model.light_attenuation[light]),
        float(model.light_cutoff[light]),
        float(model.light_exponent[light]),
        common.intensity,
        common.range_m,
        common.bulbradius_m,
    )


def _colour(values: object) -> tuple[float, float, float]:
    red, green, blue = np.asarray(values, np.float64)
    return float(red), float(green), float(blue)
