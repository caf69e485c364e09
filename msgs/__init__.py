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
from evs.msgs.frame import Frame, decode_frame, encode_frame
from evs.msgs.imu import (
    DEGREE,
    IMU_DTYPE,
    STANDARD_GRAVITY,
    ImuPacket,
    ImuSamples,
    decode_imu,
    empty_imu,
    encode_imu,
)
from evs.msgs.labels import LABEL_DTYPE, Cause, Labels, take_labels
from evs.msgs.packet import ENCODING, EventPacket, decode, encode
from evs.msgs.status import Status, decode_status, encode_status
from evs.msgs.stream import StreamInfo
from evs.msgs.topics import DEFAULT_ADDRESS, EVENTS, FRAMES, IMU, STATUS, TOPICS, Topic
from evs.msgs.trigger import (
    TRIGGER_DTYPE,
    Trigger,
    TriggerPacket,
    Triggers,
    empty_triggers,
    frame_triggers,
    make_triggers,
)

__all__ = [
    "DEFAULT_ADDRESS",
    "DEGREE",
    "ENCODING",
    "EVENTS",
    "EVENT_DTYPE",
    "FRAMES",
    "IMU",
    "IMU_DTYPE",
    "LABEL_DTYPE",
    "STANDARD_GRAVITY",
    "STATUS",
    "TOPICS",
    "TRIGGER_DTYPE",
    "Cause",
    "EventPacket",
    "Events",
    "EvsError",
    "Frame",
    "ImuPacket",
    "ImuSamples",
    "Labels",
    "MessageError",
    "Status",
    "StreamInfo",
    "Topic",
    "Trigger",
    "TriggerPacket",
    "Triggers",
    "clean_events",
    "decode",
    "decode_frame",
    "decode_imu",
    "decode_status",
    "empty_events",
    "empty_imu",
    "empty_triggers",
    "encode",
    "encode_frame",
    "encode_imu",
    "encode_status",
    "frame_triggers",
    "join_events",
    "make_events",
    "make_triggers",
    "nearest_first",
    "take_labels",
    "unknown",
]
