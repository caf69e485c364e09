"""A model as bytes, and their digest, by which a saved state knows the world that it belongs to."""

from __future__ import annotations

import hashlib

import mujoco
import numpy as np

from evs.emulator import _core
from evs.emulator.base.scene import U8


def bytes_of(model: mujoco.MjModel) -> bytes:
    """Everything in the model, as an MJB file holds it."""
    return _image(model).tobytes()


def _image(model: mujoco.MjModel) -> U8:
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer


def digest_of(model: mujoco.MjModel) -> str:
    """16 hexadecimal digits of everything in the model; 0.3 ms for a humanoid of primitives."""
    return hashlib.sha256(_image(model).data).hexdigest()[:16]


class ModelDigest:
    """digest_of one model that may be edited, found again only where it was."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._last: tuple[int, str] | None = None

    def __call__(self) -> str:
        """As of digest_of, of the model as it is now."""
        image = _image(self._model)
        quick = _core.digest([image])
        if self._last is None or self._last[0] != quick:
            self._last = quick, hashlib.sha256(image.data).hexdigest()[:16]
        return self._last[1]
