"""Names in ROS that bags and live topics share: a camera's namespace and its frames."""

from __future__ import annotations

import re
from dataclasses import dataclass

from evs.msgs import EvsError

_TOKEN = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

FRAME_KEYS = ("camera_frame_id", "imu_frame_id", "link_frame_id")
"""keys of a sink that name frames of one camera"""


@dataclass(frozen=True)
class FrameIds:
    """The frames of one camera; all have their origin in the centre of its lens."""

    camera: str
    """the optical frame, of events, images and calibration: x right, y down, z forward"""
    imu: str
    """of the IMU samples, whose axes are those of the optical frame"""
    link: str
    """the camera's body, the parent of the other two: x forward, y left, z up"""


def is_name(text: str) -> bool:
    """Whether a text is a name of a node or a namespace in ROS 2."""
    return _TOKEN.fullmatch(text) is not None and "__" not in text


def as_name(text: str) -> str:
    """The nearest name of a node in ROS 2, as in left_eye for left-eye."""
    fixed = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_") or "camera"
    fixed = fixed if fixed[0].isalpha() else f"camera_{fixed}"
    return re.sub("__+", "_", fixed)


def node_path(node: str, namespace: str, camera: str) -> str:
    """/NAMESPACE/NODE, where the node has its camera's name if no other is given.

    EvsError where that is no name in ROS.
    """
    name = node or camera
    if not is_name(name):
        key = "node" if node else "camera"
        raise EvsError(
            f"the {key} '{name}' is not a valid ROS node name (letters, digits and single _, "
            f"a letter first): set node = {as_name(name)}"
        )
    parts = [part for part in namespace.split("/") if part]
    if not all(map(is_name, parts)):
        raise EvsError(
            f"the namespace '{namespace}' is not valid in ROS: give words of letters, digits "
            "and _ with / between them, as in robot/head"
        )
    return "/" + "/".join([*parts, name])


def frame_ids(
    path: str, camera_frame_id: str = "", imu_frame_id: str = "", link_frame_id: str = ""
) -> FrameIds:
    """The frames of the camera at /NAMESPACE/NODE; those without a name get the node's."""
    node = path.rpartition("/")[2]
    return FrameIds(
        camera=camera_frame_id or f"{node}_optical_frame",
        imu=imu_frame_id or f"{node}_imu_frame",
        link=link_frame_id or f"{node}_link",
    )


def check_tree(frames: FrameIds, world_frame: str | None) -> None:
    """Check the frames that tf gets.

    Args:
        frames: Of one camera.
        world_frame: Parent of the link; None: something else publishes that.

    Raises:
        EvsError: Two of them have one name, so that tf would not be a tree.
    """
    if frames.link in (frames.camera, frames.imu):
        raise EvsError(
            f"link_frame_id and another frame of the camera are both '{frames.link}', which tf "
            "cannot hold: give two names, or set tf = false if your URDF has the frame"
        )
    if world_frame in (frames.camera, frames.imu, frames.link):
        raise EvsError(
            f"world_frame and a frame of the camera are both '{world_frame}': give two names, or "
            "set tf = false"
        )
