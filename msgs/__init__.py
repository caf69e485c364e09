"""Messages: events, packets, topics and their encodings. Names are imported at first use.

Needs only numpy and msgpack, and neither for the errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from evs.msgs.registry import load

if TYPE_CHECKING:
    from evs.msgs.camera_info import (
        CameraInfo,
        camera_info_of,
        decode_camera_info,
        encode_camera_info,
    )
    from evs.msgs.errors import EvsError, nearest_first, unknown
    from evs.msgs.event import (
        EVENT_DTYPE,
        LABEL_DTYPE,
        Cause,
        Events,
        Labels,
        clean_events,
        clear_causes,
        empty_events,
        join_events,
        make_events,
        take_labels,
    )
    from evs.msgs.frame import Frame, decode_frame, encode_frame
    from evs.msgs.ground_truth import TRUTH_CHANNELS, Truth, decode_truth, encode_truth
    from evs.msgs.header_fields import MessageError
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
    from evs.msgs.observation import Observation
    from evs.msgs.packet import ENCODING, EventPacket, decode, encode
    from evs.msgs.pose import Clock, Pose, decode_clock, decode_pose, encode_clock, encode_pose
    from evs.msgs.state import CameraState, State, decode_state, encode_state
    from evs.msgs.status import Pace, Status, decode_status, encode_status
    from evs.msgs.stream import StreamInfo
    from evs.msgs.topics import (
        CAMERA_INFO,
        CLOCK,
        DEFAULT_ADDRESS,
        EVENTS,
        FRAMES,
        IMU,
        LIGHT,
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
        external_triggers,
        frame_triggers,
        make_triggers,
    )

_HOMES = {
    "CAMERA_INFO": "evs.msgs.topics:CAMERA_INFO",
    "CLOCK": "evs.msgs.topics:CLOCK",
    "DEFAULT_ADDRESS": "evs.msgs.topics:DEFAULT_ADDRESS",
    "DEGREE": "evs.msgs.imu:DEGREE",
    "ENCODING": "evs.msgs.packet:ENCODING",
    "EVENTS": "evs.msgs.topics:EVENTS",
    "EVENT_DTYPE": "evs.msgs.event:EVENT_DTYPE",
    "FRAMES": "evs.msgs.topics:FRAMES",
    "IMU": "evs.msgs.topics:IMU",
    "LIGHT": "evs.msgs.topics:LIGHT",
    "IMU_DTYPE": "evs.msgs.imu:IMU_DTYPE",
    "LABEL_DTYPE": "evs.msgs.event:LABEL_DTYPE",
    "POSE": "evs.msgs.topics:POSE",
    "STANDARD_GRAVITY": "evs.msgs.imu:STANDARD_GRAVITY",
    "STATE_PREFIX": "evs.msgs.topics:STATE_PREFIX",
    "STATUS": "evs.msgs.topics:STATUS",
    "TOPICS": "evs.msgs.topics:TOPICS",
    "TRIGGER_DTYPE": "evs.msgs.trigger:TRIGGER_DTYPE",
    "TRUTH": "evs.msgs.topics:TRUTH",
    "TRUTH_CHANNELS": "evs.msgs.ground_truth:TRUTH_CHANNELS",
    "CameraInfo": "evs.msgs.camera_info:CameraInfo",
    "CameraState": "evs.msgs.state:CameraState",
    "Cause": "evs.msgs.event:Cause",
    "Clock": "evs.msgs.pose:Clock",
    "EventPacket": "evs.msgs.packet:EventPacket",
    "Events": "evs.msgs.event:Events",
    "EvsError": "evs.msgs.errors:EvsError",
    "Frame": "evs.msgs.frame:Frame",
    "ImuPacket": "evs.msgs.imu:ImuPacket",
    "ImuSamples": "evs.msgs.imu:ImuSamples",
    "Labels": "evs.msgs.event:Labels",
    "MessageError": "evs.msgs.header_fields:MessageError",
    "Observation": "evs.msgs.observation:Observation",
    "Pace": "evs.msgs.status:Pace",
    "Pose": "evs.msgs.pose:Pose",
    "State": "evs.msgs.state:State",
    "Status": "evs.msgs.status:Status",
    "StreamInfo": "evs.msgs.stream:StreamInfo",
    "Topic": "evs.msgs.topics:Topic",
    "Trigger": "evs.msgs.trigger:Trigger",
    "TriggerPacket": "evs.msgs.trigger:TriggerPacket",
    "Triggers": "evs.msgs.trigger:Triggers",
    "Truth": "evs.msgs.ground_truth:Truth",
    "camera_info_of": "evs.msgs.camera_info:camera_info_of",
    "clean_events": "evs.msgs.event:clean_events",
    "clear_causes": "evs.msgs.event:clear_causes",
    "decode": "evs.msgs.packet:decode",
    "decode_camera_info": "evs.msgs.camera_info:decode_camera_info",
    "decode_clock": "evs.msgs.pose:decode_clock",
    "decode_frame": "evs.msgs.frame:decode_frame",
    "decode_imu": "evs.msgs.imu:decode_imu",
    "decode_pose": "evs.msgs.pose:decode_pose",
    "decode_state": "evs.msgs.state:decode_state",
    "decode_status": "evs.msgs.status:decode_status",
    "decode_truth": "evs.msgs.ground_truth:decode_truth",
    "empty_events": "evs.msgs.event:empty_events",
    "empty_imu": "evs.msgs.imu:empty_imu",
    "empty_triggers": "evs.msgs.trigger:empty_triggers",
    "encode": "evs.msgs.packet:encode",
    "encode_camera_info": "evs.msgs.camera_info:encode_camera_info",
    "encode_clock": "evs.msgs.pose:encode_clock",
    "encode_frame": "evs.msgs.frame:encode_frame",
    "encode_imu": "evs.msgs.imu:encode_imu",
    "encode_pose": "evs.msgs.pose:encode_pose",
    "encode_state": "evs.msgs.state:encode_state",
    "encode_status": "evs.msgs.status:encode_status",
    "encode_truth": "evs.msgs.ground_truth:encode_truth",
    "external_triggers": "evs.msgs.trigger:external_triggers",
    "frame_triggers": "evs.msgs.trigger:frame_triggers",
    "join_events": "evs.msgs.event:join_events",
    "make_events": "evs.msgs.event:make_events",
    "make_triggers": "evs.msgs.trigger:make_triggers",
    "nearest_first": "evs.msgs.errors:nearest_first",
    "take_labels": "evs.msgs.event:take_labels",
    "unknown": "evs.msgs.errors:unknown",
}

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
    "LIGHT",
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
    "Pace",
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
    "clear_causes",
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
    "external_triggers",
    "frame_triggers",
    "join_events",
    "make_events",
    "make_triggers",
    "nearest_first",
    "take_labels",
    "unknown",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'evs.msgs' has no attribute {name!r}")
    value = load(_HOMES[name])
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
