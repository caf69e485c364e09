"""What a payload encoding of event_camera_msgs/EventPacket is."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, Protocol

from evs.msgs.codecs.limits import EncodingLimits
from evs.msgs.event import Events
from evs.msgs.trigger import Triggers


class Payload(NamedTuple):
    """What an event_camera_msgs/EventPacket carries."""

    time_base_ns: int
    """its time_base; what it means is the encoding's"""
    data: bytes
    """its events"""


class Codec(Protocol):
    """Encodes or decodes the payloads of one camera, one after the other."""

    limits: ClassVar[EncodingLimits]
    longest_s: ClassVar[float] = 1000.0
    """longest message that decoders read, from its first event on, s"""
    about: ClassVar[str]
    """what help texts add to its name"""
    has_clock: ClassVar[bool] = False
    """whether payloads continue one stream of words, which holds the time and external triggers"""
    most_bytes: ClassVar[int] = 1 << 62
    """most bytes of a payload that is decoded at once"""
    time_origin_us: int
    skipped: int = 0
    """events so far that a decoder could not place: they came before the first time stamp"""

    def __init__(self, time_origin_us: int) -> None:
        """Start a stream whose clock, if it has one, reads `time_origin_us` at time zero."""
        self.time_origin_us = time_origin_us

    def encode(self, events: Events, time_base_us: int | None) -> Payload:
        """As PayloadWriter.payload."""
        ...

    def decode(self, data: Any, time_base_ns: int, triggers: list[Triggers] | None) -> Events:
        """As PayloadReader.events."""
        ...
