"""Offsets of a micrometre, which MuJoCo leaves out.

Its compiler takes a geom less than 1e-6 m off its body's frame, or the frame of the body's inertia,
for one that lies there (geom_sameframe), and its kinematics then copy the pose. In a world of
micrometres that is another picture, and another motion.
"""

from __future__ import annotations

import mujoco
import numpy as np

SMALL_SHARE = 1e-4
"""An offset over this share of the geom's own radius counts; under it nothing is to be seen of it,
and the pose stays the copy that MuJoCo makes of it."""


def keep_offsets(model: mujoco.MjModel) -> None:
    """Let such geoms lie where the model has them. The model is changed: give it a copy."""
    same = mujoco.mjtSameFrame
    offset = np.array(model.geom_pos)
    inertia = model.geom_sameframe == int(same.mjSAMEFRAME_INERTIA)
    offset[inertia] -= model.body_ipos[model.geom_bodyid[inertia]]
    copied = inertia | (model.geom_sameframe == int(same.mjSAMEFRAME_BODY))
    # a plane has no radius, nor any size that it would be small beside
    radius = np.where(model.geom_rbound > 0.0, model.geom_rbound, np.inf)
    seen = copied & (np.abs(offset).max(axis=1) > SMALL_SHARE * radius)
    model.geom_sameframe[seen] = int(same.mjSAMEFRAME_NONE)
