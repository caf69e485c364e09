"""The topics of the node: rclpy's publishers, to which evs gives messages as bytes."""

from __future__ import annotations

from typing import Any

from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import PoseStamped
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, Imu
from tf2_msgs.msg import TFMessage

from evs.drivers.ros2.names import Quality

TYPES = {
    "event_camera_msgs/msg/EventPacket": EventPacket,
    "geometry_msgs/msg/PoseStamped": PoseStamped,
    "rosgraph_msgs/msg/Clock": Clock,
    "sensor_msgs/msg/CameraInfo": CameraInfo,
    "sensor_msgs/msg/Image": Image,
    "sensor_msgs/msg/Imu": Imu,
    "tf2_msgs/msg/TFMessage": TFMessage,
}
"""name of a type -> its class"""


def profile(quality: Quality) -> QoSProfile:
    """The QoS profile of rclpy for a quality of service."""
    reliability, durability = ReliabilityPolicy, DurabilityPolicy
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=quality.depth,
        reliability=reliability.RELIABLE if quality.reliable else reliability.BEST_EFFORT,
        durability=(durability.TRANSIENT_LOCAL if quality.transient_local else durability.VOLATILE),
    )


class NodeConnection:
    """Makes the writers of a sink from publishers of a node."""

    def __init__(self, node: LifecycleNode) -> None:
        self._node = node

    def writer(self, name: str, kind: str, quality: Quality) -> NodeWriter:
        """Make a writer for a topic.

        A managed publisher is silent while the node is inactive. Static transforms are published
        when the node is configured, as by tf2's own broadcaster, which is not managed either.
        """
        node = self._node
        make = node.create_publisher if quality.transient_local else node.create_lifecycle_publisher
        return NodeWriter(node, make(TYPES[kind], name, profile(quality)))

    def close(self) -> None:
        """Nothing is left: every writer is closed by itself."""


class NodeWriter:
    """Writes the messages of one topic."""

    def __init__(self, node: LifecycleNode, publisher: Any) -> None:
        self._node, self._publisher = node, publisher

    @property
    def readers(self) -> int:
        """Number of subscriptions."""
        return int(self._publisher.get_subscription_count())

    def write(self, data: bytes) -> bool:
        """Publish one message; return False once ROS was shut down, as by Ctrl-C."""
        if not self._node.context.ok():
            return False
        self._publisher.publish(data)
        return True

    def wait(self, seconds: float) -> bool:  # noqa: ARG002
        """Return at once: the middleware delivers what it has taken, as for other nodes."""
        return True

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_lifecycle_publisher(self._publisher)
