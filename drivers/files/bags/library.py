"""rosbags, where it is installed, and the message types that event cameras use."""

from __future__ import annotations

from functools import cache
from typing import Any

from evs.msgs import EvsError

PACKET = "event_camera_msgs/msg/EventPacket"
ARRAY = "dvs_msgs/msg/EventArray"
EVENT = "dvs_msgs/msg/Event"
TEXT = "std_msgs/msg/String"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

DEFINITIONS = {
    PACKET: """std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
""",
    EVENT: """uint16 x
uint16 y
{time} ts
bool polarity
""",
    ARRAY: """std_msgs/Header header
uint32 height
uint32 width
dvs_msgs/Event[] events
""",
    TRANSFORMS: "geometry_msgs/TransformStamped[] transforms\n",
}
"""message type -> its definition, as its package has it"""


def load() -> Any:
    """Import the library; EvsError names the extra where it is missing."""
    try:
        import rosbags.interfaces
        import rosbags.rosbag1
        import rosbags.rosbag2
        import rosbags.typesys
    except ImportError:
        raise EvsError("ROS bags need rosbags: pip install 'evs[ros2]'") from None
    return rosbags


@cache
def typestore(ros: int) -> Any:
    """All message types that evs uses, of ROS 1 or 2; making it takes 50 ms."""
    types = load().typesys
    store = types.get_typestore(types.Stores.ROS1_NOETIC if ros == 1 else types.Stores.ROS2_HUMBLE)
    time = "time" if ros == 1 else "builtin_interfaces/Time"
    for name, definition in DEFINITIONS.items():
        if name not in store.types:
            text = definition.replace("{time}", time)
            store.register(types.get_types_from_msg(text, name))
    return store
