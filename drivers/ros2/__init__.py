"""A camera for ROS 2: topics over DDS, without ROS (extra `ros2`)."""

from evs.drivers.ros2.publisher import Ros2Publisher

__all__ = ["Ros2Publisher"]
