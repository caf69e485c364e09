"""Numbers in a model that point to other parts of it: MuJoCo and renderers follow them blindly."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from evs.msgs import EvsError

BODIES = (
    *("body_parentid", "body_rootid", "body_weldid", "geom_bodyid", "cam_bodyid", "light_bodyid"),
    *("cam_targetbodyid", "light_targetbodyid"),
)
TARGETS = {
    **dict.fromkeys(BODIES, "nbody"),
    **dict.fromkeys(("geom_matid", "skin_matid", "flex_matid"), "nmat"),
    **dict.fromkeys(("mat_texid", "light_texid"), "ntex"),
    "body_mocapid": "nmocap",
}
"""field of mjModel -> what its values count; -1 is none"""

DATA = {
    mujoco.mjtGeom.mjGEOM_HFIELD: "nhfield",
    mujoco.mjtGeom.mjGEOM_MESH: "nmesh",
    mujoco.mjtGeom.mjGEOM_SDF: "nmesh",
}
"""type of geom -> what geom_dataid counts"""


def check_indices(model: mujoco.MjModel) -> None:
    """EvsError where an index points to what the model does not have."""
    for field, count in TARGETS.items():
        values = getattr(model, field, None)
        if values is not None:
            _check(field, np.asarray(values), count, int(getattr(model, count)))
    for kind, count in DATA.items():
        rows = np.asarray(model.geom_type) == kind
        values = np.where(rows, np.asarray(model.geom_dataid), -1)
        _check("geom_dataid", values, count, int(getattr(model, count)))


def _check(field: str, values: npt.NDArray[np.int32], count: str, end: int) -> None:
    bad = np.argwhere((values < -1) | (values >= end))
    if len(bad):
        place = tuple(int(one) for one in bad[0])
        raise EvsError(
            f"model.{field}[{', '.join(map(str, place))}] is {int(values[place])}, but {count} is "
            f"{end}: it points to nothing; put it back"
        )
