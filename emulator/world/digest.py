"""Digest of a model: by which a saved state knows the world that it belongs to."""

from __future__ import annotations

import hashlib

import mujoco
import numpy as np


def digest_of(model: mujoco.MjModel) -> str:
    """16 hexadecimal digits of everything in the model; 0.3 ms for a humanoid of primitives."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return hashlib.sha256(buffer.data).hexdigest()[:16]
