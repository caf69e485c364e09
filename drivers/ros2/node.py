"""One camera as a ROS node: its topics, and what is under way to them."""

from __future__ import annotations

from dataclasses import dataclass

from evs.drivers.ros2.event_messages import EventMessageBuilder
from evs.drivers.ros2.messages import Messages
from evs.drivers.ros2.sender import TopicQueue
from evs.drivers.ros2.statistics import Statistics
from evs.msgs import StreamInfo

INFO_PERIOD_US = 100_000
"""How often camera_info is published where no images are."""


class Topic:
    """A topic and its readers at the last check."""

    def __init__(self, name: str, queue: TopicQueue, readers: int = 0) -> None:
        self.name, self.queue, self.readers = name, queue, readers


@dataclass
class Node:
    """One camera's part of a sink."""

    stream: StreamInfo
    path: str
    """/NAMESPACE/NODE"""
    messages: Messages
    builder: EventMessageBuilder
    statistics: Statistics
    topics: dict[str, Topic]
    """name behind the path -> topic; only those that the camera has something for"""
    info_due_us: int = -(2**62)
    time_end_us: int = -(2**62)
    """of its last packet"""

    def listened(self, name: str) -> bool:
        """Return whether a reader of the topic was there at the last check."""
        topic = self.topics.get(name)
        return topic is not None and topic.readers > 0

    def info_is_due(self, t_us: int) -> bool:
        """Return whether camera_info is due at t_us; with images it comes with each of them."""
        if self.stream.frames or not self.listened("camera_info") or t_us < self.info_due_us:
            return False
        self.info_due_us = t_us - t_us % INFO_PERIOD_US + INFO_PERIOD_US
        return True
