"""The topics of a camera in ROS 2: names, types, and the quality of service of the real drivers."""

from __future__ import annotations

from dataclasses import dataclass

from evs.drivers.files.bags.library import PACKET, TRANSFORMS
from evs.drivers.files.bags.messages import IMAGE, INFO, POSE, SAMPLE, TOPICS

CLOCK = "rosgraph_msgs/msg/Clock"

PRIVATE = {
    "events": PACKET,
    TOPICS[SAMPLE]: SAMPLE,
    TOPICS[INFO]: INFO,
    TOPICS[IMAGE]: IMAGE,
    TOPICS[POSE]: POSE,
}
"""name behind the node's -> type"""

GLOBAL = {"/clock": CLOCK, "/tf": TRANSFORMS, "/tf_static": TRANSFORMS}
"""topics of all nodes together -> type"""


@dataclass(frozen=True)
class Quality:
    """Quality of service of a writer; history is keep last."""

    reliable: bool
    """whether lost messages are sent again; a reader that requests this needs it"""
    depth: int
    """most messages that are kept for slow readers"""
    transient_local: bool = False
    """whether readers that come later get the last message"""


TF = {
    "/tf": Quality(reliable=True, depth=100),
    "/tf_static": Quality(reliable=True, depth=1, transient_local=True),
}
"""as tf2's broadcasters have it; its listeners request nothing less"""

RELIABLE = ("image_raw", "camera_info", "pose")
"""reliable as ROS's publishers are by default, with which libcaer_driver sends images; the drivers'
events and IMU samples, and /clock, are best effort"""

DEPTHS = {"image_raw": 10, "camera_info": 10, "/clock": 1}
"""depths other than `send_queue_size`: of rmw_qos_profile_default, and of rclcpp::ClockQoS"""


def quality_of(name: str, reliable: bool | None, depth: int) -> Quality:
    """The quality of service of a topic.

    Args:
        name: A key of PRIVATE or GLOBAL.
        reliable: The sink's key for all topics but tf; None: as the drivers have it.
        depth: Depth of topics without one of their own.
    """
    if name in TF:
        return TF[name]
    return Quality(name in RELIABLE if reliable is None else reliable, DEPTHS.get(name, depth))
