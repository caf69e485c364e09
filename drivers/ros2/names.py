"""Names of ROS: of nodes and namespaces, and of the topics behind them."""

from __future__ import annotations

import re

from evs.drivers.files.bags.library import PACKET
from evs.drivers.files.bags.messages import IMAGE, INFO, SAMPLE, TOPICS
from evs.msgs import EvsError

POSE = "geometry_msgs/msg/PoseStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
CLOCK = "rosgraph_msgs/msg/Clock"

PRIVATE = {
    "events": PACKET,
    TOPICS[SAMPLE]: SAMPLE,
    TOPICS[INFO]: INFO,
    TOPICS[IMAGE]: IMAGE,
    "pose": POSE,
}
"""name behind the node's -> type"""

GLOBAL = {"/clock": CLOCK, "/tf": TRANSFORMS}
"""topics of all nodes together -> type"""

_TOKEN = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def node_path(node: str, namespace: str, camera: str) -> str:
    """/NAMESPACE/NODE, where the node has its camera's name if no other is given.

    EvsError where that is no name in ROS.
    """
    name = node or camera
    if _TOKEN.fullmatch(name) is None or "__" in name:
        key = "node" if node else "camera"
        fix = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "camera"
        fix = fix if fix[0].isalpha() else f"camera_{fix}"
        raise EvsError(
            f"the {key} '{name}' is not a valid ROS node name (letters, digits and single _, "
            f"a letter first): set node = {re.sub('__+', '_', fix)}"
        )
    parts = [part for part in namespace.split("/") if part]
    for part in parts:
        if _TOKEN.fullmatch(part) is None or "__" in part:
            raise EvsError(
                f"the namespace '{namespace}' is not valid in ROS: give words of letters, digits "
                "and _ with / between them, as in robot/head"
            )
    return "/" + "/".join([*parts, name])
