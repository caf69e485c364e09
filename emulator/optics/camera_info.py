"""A camera as ROS describes it: sensor_msgs/CameraInfo, and the pose of its optical frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from evs.emulator.base.scene import F64, CameraModel, CameraPose
from evs.msgs import Pose


def camera_info(camera: CameraModel) -> dict[str, Any]:
    """width, height, distortion_model, d, k (9), r (9), p (12); plain values.

    There the centre of the first pixel is 0, here its corner is: the principal point is 0.5 less.
    An ideal lens is a plumb_bob of zeros. One camera alone is rectified without a turn, and the
    rectified picture has the same focal lengths: r is the identity and p is k.
    """
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx - 0.5, camera.cy - 0.5
    ideal = camera.distortion_model == "none"
    info: dict[str, Any] = {
        "width": camera.width,
        "height": camera.height,
        "distortion_model": "plumb_bob" if ideal else camera.distortion_model,
        "d": [0.0] * 5 if ideal else list(camera.distortion),
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
    if camera.orthographic:
        # ROS knows no such camera: k is in px per m here
        info["projection"] = "orthographic"
    return info


def pose_message(pose: CameraPose, seq: int, t_us: int, camera: str) -> Pose:
    """The pose of the optical frame (x right, y down, z forward); the camera's own has y up.

    The quaternion's largest component is positive, so that it does not jump where w is near zero
    and is the same for the same pose.
    """
    x, y, z = (float(value) for value in pose.pos)
    turned = np.asarray(pose.mat, np.float64).reshape(3, 3) * (1.0, -1.0, -1.0)
    return Pose(seq, t_us, (x, y, z), _quaternion(turned), camera)


def _quaternion(m: F64) -> tuple[float, float, float, float]:
    """(x, y, z, w) of a rotation matrix: from its largest component, which loses no digits.

    Shepperd, Quaternion from rotation matrix, Journal of Guidance and Control 1 (1978).
    """
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    sums = (2 * m[0, 0] - trace, 2 * m[1, 1] - trace, 2 * m[2, 2] - trace, trace)
    largest = int(np.argmax(sums))
    size = math.sqrt(1.0 + sums[largest])
    found = [0.0, 0.0, 0.0, 0.0]
    found[largest] = 0.5 * size
    if largest == 3:
        pairs = {0: m[2, 1] - m[1, 2], 1: m[0, 2] - m[2, 0], 2: m[1, 0] - m[0, 1]}
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        pairs = {j: m[i, j] + m[j, i], k: m[i, k] + m[k, i], 3: m[k, j] - m[j, k]}
    for place, value in pairs.items():
        found[place] = 0.5 * float(value) / size
    norm = math.sqrt(math.fsum(value * value for value in found))
    a, b, c, d = (value / norm for value in found)
    return a, b, c, d
