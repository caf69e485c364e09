"""What is said: events, packets, topics. Needs numpy and msgpack only."""

from evs.msgs.camera_info import (
    CameraInfo,
    camera_info_of,
    decode_camera_info,
    encode_camera_info,
)
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
from evs.msgs.observation import Observation
from evs.msgs.packet import ENCODING, EventPacket, decode, encode
from evs.msgs.pose import Clock, Pose, decode_clock, decode_pose, encode_clock, encode_pose
from evs.msgs.state import CameraState, State, decode_state, encode_state
from evs.msgs.status import Status, decode_status, encode_status
from evs.msgs.stream import StreamInfo
from evs.msgs.topics import (
    CAMERA_INFO,
    CLOCK,
    DEFAULT_ADDRESS,
    EVENTS,
    FRAMES,
    IMU,
    POSE,
    STATE_PREFIX,
    STATUS,
    TOPICS,
    TRUTH,
    Topic,
)
from evs.msgs.trigger import (
    TRIGGER_DTYPE,
    Trigger,
    TriggerPacket,
    Triggers,
    empty_triggers,
    frame_triggers,
    make_triggers,
)
from evs.msgs.truth import TRUTH_CHANNELS, Truth, decode_truth, encode_truth

__all__ = [
    "CAMERA_INFO",
    "CLOCK",
    "DEFAULT_ADDRESS",
    "DEGREE",
    "ENCODING",
    "EVENTS",
    "EVENT_DTYPE",
    "FRAMES",
    "IMU",
    "IMU_DTYPE",
    "LABEL_DTYPE",
    "POSE",
    "STANDARD_GRAVITY",
    "STATE_PREFIX",
    "STATUS",
    "TOPICS",
    "TRIGGER_DTYPE",
    "TRUTH",
    "TRUTH_CHANNELS",
    "CameraInfo",
    "CameraState",
    "Cause",
    "Clock",
    "EventPacket",
    "Events",
    "EvsError",
    "Frame",
    "ImuPacket",
    "ImuSamples",
    "Labels",
    "MessageError",
    "Observation",
    "Pose",
    "State",
    "Status",
    "StreamInfo",
    "Topic",
    "Trigger",
    "TriggerPacket",
    "Triggers",
    "Truth",
    "camera_info_of",
    "clean_events",
    "decode",
    "decode_camera_info",
    "decode_clock",
    "decode_frame",
    "decode_imu",
    "decode_pose",
    "decode_state",
    "decode_status",
    "decode_truth",
    "empty_events",
    "empty_imu",
    "empty_triggers",
    "encode",
    "encode_camera_info",
    "encode_clock",
    "encode_frame",
    "encode_imu",
    "encode_pose",
    "encode_state",
    "encode_status",
    "encode_truth",
    "frame_triggers",
    "join_events",
    "make_events",
    "make_triggers",
    "nearest_first",
    "take_labels",
    "unknown",
]
