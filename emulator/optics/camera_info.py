"""A camera's parameters in the fields of ROS's sensor_msgs/CameraInfo."""

from __future__ import annotations

from typing import Any

from evs.emulator.base.scene import CameraModel


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
