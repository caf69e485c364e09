"""ROS 1 and ROS 2 bags: recorders and reader. Only this package imports rosbags (extra `ros2`)."""

from evs.drivers.files.bags.reader import BagFile
from evs.drivers.files.bags.recorder import Ros1Recorder, Ros2Recorder
from evs.drivers.files.bags.repair import repair

__all__ = ["BagFile", "Ros1Recorder", "Ros2Recorder", "repair"]
