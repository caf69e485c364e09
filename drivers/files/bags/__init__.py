"""ROS bags, of ROS 1 and 2: recorders and reader. The door to rosbags (extra `ros2`)."""

from evs.drivers.files.bags.reader import BagFile
from evs.drivers.files.bags.recorder import Ros1Recorder, Ros2Recorder
from evs.drivers.files.bags.repair import repair

__all__ = ["BagFile", "Ros1Recorder", "Ros2Recorder", "repair"]
