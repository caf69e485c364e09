"""Names of the things in a model, as errors and lookups need them."""

from __future__ import annotations

import mujoco

from evs.emulator.world.compat import ACTUATOR_COUNT
from evs.msgs import unknown

COUNTS = {
    mujoco.mjtObj.mjOBJ_BODY: "nbody",
    mujoco.mjtObj.mjOBJ_JOINT: "njnt",
    mujoco.mjtObj.mjOBJ_GEOM: "ngeom",
    mujoco.mjtObj.mjOBJ_CAMERA: "ncam",
    mujoco.mjtObj.mjOBJ_ACTUATOR: ACTUATOR_COUNT,
    mujoco.mjtObj.mjOBJ_KEY: "nkey",
    mujoco.mjtObj.mjOBJ_SENSOR: "nsensor",
    mujoco.mjtObj.mjOBJ_TEXTURE: "ntex",
}
"""Where the model keeps the number of objects of a kind."""


def name_of(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    """The object's name, or its number where it has none."""
    return str(mujoco.mj_id2name(model, kind, index) or index)


def names_of(model: mujoco.MjModel, kind: mujoco.mjtObj) -> list[str]:
    """The names of all objects of a kind, in the order of their ids."""
    return [name_of(model, kind, index) for index in range(getattr(model, COUNTS[kind]))]


def find(model: mujoco.MjModel, kind: mujoco.mjtObj, label: str, name: str) -> int:
    """Find an object by name or number.

    Args:
        model: The model.
        kind: Of the object.
        label: What to call the kind in the error.
        name: Its name, or its number.

    Returns:
        Its id.

    Raises:
        EvsError: There is none; the message lists what there is.
    """
    index = int(mujoco.mj_name2id(model, kind, name))
    if index >= 0:
        return index
    if name.isdecimal() and int(name) < getattr(model, COUNTS[kind]):
        return int(name)
    raise unknown(label, name, names_of(model, kind))


def one_line(reason: object) -> str:
    """MuJoCo's message, which may have several lines, as one."""
    return "; ".join(line.strip() for line in str(reason).splitlines() if line.strip())
