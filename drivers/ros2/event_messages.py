"""Event messages made of the packets of ticks, by thresholds of time and size."""

from __future__ import annotations

from dataclasses import dataclass

from evs.msgs import EventPacket, EvsError
from evs.msgs.codecs import LAST_ROS_US, PAYLOADS, TIME_ORIGIN_US, PayloadWriter


@dataclass(frozen=True)
class EventMessage:
    """The content of an event_camera_msgs/EventPacket."""

    first_us: int
    """simulated time of its first event"""
    last_us: int
    time_base_ns: int
    data: bytes
    events: int
    """number of its events"""


class EventMessageBuilder:
    """Gathers one camera's packets; every packet is encoded as it comes."""

    def __init__(
        self, encoding: str, time_threshold_s: float, size_threshold: int, start_us: int = 0
    ) -> None:
        """Start with no events.

        Args:
            encoding: A key of PAYLOADS.
            time_threshold_s: Least time that a message spans, s, unless it reaches its size before.
            size_threshold: The size at which a message is complete, bytes.
            start_us: Start of the stream, us, at which evt3's clock reads 1 s.

        Raises:
            EvsError: A threshold is out of range.
        """
        self._writer = PayloadWriter(encoding, time_origin_us=TIME_ORIGIN_US - start_us)
        longest_s = PAYLOADS[encoding].longest_s
        if not 0 <= time_threshold_s <= longest_s:
            raise EvsError(
                f"event_message_time_threshold is {time_threshold_s:g} s, a message in {encoding} "
                f"spans {longest_s:g} s at most: give less, 0 (a message a tick) or more, or "
                "encoding = evt3"
            )
        if size_threshold < 1:
            raise EvsError(
                f"event_message_size_threshold is {size_threshold}: give the bytes, 1 or more"
            )
        self._time_us = round(time_threshold_s * 1e6)
        self._size = size_threshold
        self._parts: list[bytes] = []
        self._begin_us = self._first_us = self._last_us = 0
        self._base_ns = self._bytes = self._events = 0

    @property
    def encoding(self) -> str:
        """Its name, as messages have it."""
        return self._writer.encoding

    def add(self, packet: EventPacket) -> list[EventMessage]:
        """Add one packet; return the message that it completes, if any."""
        if len(packet):
            base_us = self._first_us if self._parts else None
            base_ns, data = self._writer.payload(packet.events, base_us)
            if not self._parts:
                self._begin_us = packet.time_base_us
                self._first_us = int(packet.events["t"][0])
                self._base_ns = base_ns
            self._last_us = int(packet.events["t"][-1])
            self._parts.append(data)
            self._bytes += len(data)
            self._events += len(packet)
        is_long = packet.time_end_us - self._begin_us >= self._time_us
        return self.rest() if is_long or self._bytes >= self._size else []

    def rest(self) -> list[EventMessage]:
        """The events gathered so far as a message; an empty list if there are none."""
        if not self._parts:
            return []
        data = self._parts[0] if len(self._parts) == 1 else b"".join(self._parts)
        message = EventMessage(self._first_us, self._last_us, self._base_ns, data, self._events)
        self._parts, self._bytes, self._events = [], 0, 0
        return [message]


def check_start(start_us: int, camera: str) -> None:
    """Check the start of a stream. EvsError: ROS's time ends before it."""
    if start_us > LAST_ROS_US:
        raise EvsError(
            f"camera '{camera}' begins at {start_us} us, ROS's time ends at {LAST_ROS_US} us: give "
            "a smaller scene.start_us"
        )


def check_size(encoding: str, width: int, height: int, camera: str) -> None:
    """Check the size of a sensor. EvsError: the encoding has too few bits for it."""
    limits = PAYLOADS[encoding].limits
    if width > limits.width or height > limits.height:
        raise EvsError(
            f"camera '{camera}' has {width} x {height} px, {limits.name} holds {limits.width} x "
            f"{limits.height}: set encoding = libcaer"
        )
