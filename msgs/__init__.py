"""What is said: events, packets, topics. Needs numpy and msgpack only."""

from evs.msgs.errors import EvsError, nearest_first, unknown
from evs.msgs.event import (
    EVENT_DTYPE,
    Events,
    clean_events,
    empty_events,
    join_events,
    make_events,
)
from evs.msgs.fields import MessageError
from evs.msgs.packet import ENCODING, EventPacket, decode, encode
from evs.msgs.status import Status, decode_status, encode_status
from evs.msgs.stream import StreamInfo
from evs.msgs.topics import DEFAULT_ADDRESS, EVENTS, STATUS, TOPICS, Topic

__all__ = [
    "DEFAULT_ADDRESS",
    "ENCODING",
    "EVENTS",
    "EVENT_DTYPE",
    "STATUS",
    "TOPICS",
    "EventPacket",
    "Events",
    "EvsError",
    "MessageError",
    "Status",
    "StreamInfo",
    "Topic",
    "clean_events",
    "decode",
    "decode_status",
    "empty_events",
    "encode",
    "encode_status",
    "join_events",
    "make_events",
    "nearest_first",
    "unknown",
]
