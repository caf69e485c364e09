"""What MuJoCo 3.3 to 4 store or count differently: the one place that branches on its version.

Each function tests for the feature, not for a version number, so that a later MuJoCo that keeps the
newest form needs no line here.
"""

from __future__ import annotations

import warnings
from functools import cache

import mujoco

LIGHT_DEFAULTS = {"intensity": 0.0, "range": 10.0, "softness": 0.2}
"""What lights have where this MuJoCo stores no such number: its defaults since it does."""

SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
"""The enable flag of sleeping bodies; 0 before MuJoCo 3.4, which has none."""

ACTUATOR_COUNT = "nactuator" if hasattr(mujoco.MjModel, "nactuator") else "nu"
"""Where the model keeps its number of actuators. Before it kept one, each had one control."""

ORTHOGRAPHIC = (
    'projection="orthographic"' if hasattr(mujoco, "mjtProjection") else 'orthographic="true"'
)
"""What makes a camera in MJCF project in parallel; MuJoCo 3.5 and later know the first alone."""


WRONG_NEWTON = "4.0.0"
"""The MuJoCo whose Newton solver is wrong where it is sparse (its issue 3767). 4.0.1 is mended:
once it is on the package index, exclude this in pyproject.toml and drop `warn_wrong_newton`."""


def warn_wrong_newton(model: mujoco.MjModel) -> None:
    """Warn where this MuJoCo solves the constraints of a model wrongly."""
    newton = model.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON
    if str(mujoco.__version__) == WRONG_NEWTON and newton and mujoco.mj_isSparse(model):
        warnings.warn(
            f"MuJoCo {WRONG_NEWTON} solves contacts of models as large as this wrongly (its issue "
            '3767): give the model <option jacobian="dense"/>, or install another MuJoCo (pip '
            f"install 'mujoco!={WRONG_NEWTON}')",
            stacklevel=2,
        )


def light_type(model: mujoco.MjModel, light: int) -> int:
    """The light's mjtLightType: 0 spot, 1 directional, 2 point, 3 image."""
    if hasattr(model, "light_type"):
        return int(model.light_type[light])
    # the values of the flag are those of the first two types
    return int(model.light_directional[light])


def light_number(model: mujoco.MjModel, attribute: str, light: int) -> float:
    """One number of a light, such as `range`."""
    stored = getattr(model, f"light_{attribute}", None)
    return LIGHT_DEFAULTS[attribute] if stored is None else float(stored[light])


def is_orthographic(model: mujoco.MjModel, camera: int) -> bool:
    """Whether a camera of the model projects in parallel."""
    if hasattr(model, "cam_projection"):
        projection = mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC
        return bool(model.cam_projection[camera] == projection)
    return bool(model.cam_orthographic[camera])


def gloss_is_given(attribute: str, value: float) -> bool:
    """Whether a material's `metallic` or `roughness` was set, and is not this MuJoCo's default.

    The default is -1 today. Where it is 1, as in 3.3.0, a 1 that was set looks the same.
    """
    return value != _gloss_default(attribute)


def actuator_of(model: mujoco.MjModel, control: int) -> int:
    """The id of the actuator that owns a control."""
    if hasattr(model, "actuator_ctrladr"):
        return int((model.actuator_ctrladr <= control).sum()) - 1
    return control


@cache
def _gloss_default(attribute: str) -> float:
    return float(getattr(mujoco.MjSpec().add_material(), attribute))
