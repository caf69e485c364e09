"""A camera as ROS 2 sees one: topics over DDS, without ROS (extra `ros2`)."""

from evs.drivers.ros2.publisher import Ros2Publisher

__all__ = ["Ros2Publisher"]
