"""What is said: events, packets, topics. Needs numpy and msgpack only."""

from evs.msgs.errors import EvsError, nearest_first, unknown
from evs.msgs.event import EVENT_DTYPE, Events, empty_events, make_events
from evs.msgs.packet import ENCODING, EventPacket, MessageError, decode, encode
from evs.msgs.stream import StreamInfo
from evs.msgs.topics import TOPICS, Topic

__all__ = [
    "ENCODING",
    "EVENT_DTYPE",
    "TOPICS",
    "EventPacket",
    "Events",
    "EvsError",
    "MessageError",
    "StreamInfo",
    "Topic",
    "decode",
    "empty_events",
    "encode",
    "make_events",
    "nearest_first",
    "unknown",
]
