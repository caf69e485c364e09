"""Quaternions of ROS as matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def rotation(turn: Any) -> npt.NDArray[np.float64]:
    """(3, 3) the matrix of a Quaternion message."""
    vector, w = np.array([turn.x, turn.y, turn.z]), turn.w
    cross = np.cross(np.eye(3), vector)
    return np.asarray(
        (w * w - vector @ vector) * np.eye(3) + 2 * np.outer(vector, vector) + 2 * w * cross
    )
