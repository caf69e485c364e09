"""The names of evs.msgs, each imported on first use."""

from .camera_info import (
    CameraInfo as CameraInfo,
    camera_info_of as camera_info_of,
    decode_camera_info as decode_camera_info,
    encode_camera_info as encode_camera_info,
)
from .errors import (
    EvsError as EvsError,
    nearest_first as nearest_first,
    unknown as unknown,
)
from .event import (
    Cause as Cause,
    EVENT_DTYPE as EVENT_DTYPE,
    Events as Events,
    LABEL_DTYPE as LABEL_DTYPE,
    Labels as Labels,
    clean_events as clean_events,
    clear_causes as clear_causes,
    empty_events as empty_events,
    join_events as join_events,
    make_events as make_events,
    take_labels as take_labels,
)
from .frame import (
    Frame as Frame,
    decode_frame as decode_frame,
    encode_frame as encode_frame,
)
from .ground_truth import (
    TRUTH_CHANNELS as TRUTH_CHANNELS,
    Truth as Truth,
    decode_truth as decode_truth,
    encode_truth as encode_truth,
)
from .header_fields import MessageError as MessageError
from .imu import (
    DEGREE as DEGREE,
    IMU_DTYPE as IMU_DTYPE,
    ImuPacket as ImuPacket,
    ImuSamples as ImuSamples,
    STANDARD_GRAVITY as STANDARD_GRAVITY,
    decode_imu as decode_imu,
    empty_imu as empty_imu,
    encode_imu as encode_imu,
)
from .observation import Observation as Observation
from .packet import (
    ENCODING as ENCODING,
    EventPacket as EventPacket,
    decode as decode,
    encode as encode,
)
from .pose import (
    Clock as Clock,
    Pose as Pose,
    decode_clock as decode_clock,
    decode_pose as decode_pose,
    encode_clock as encode_clock,
    encode_pose as encode_pose,
)
from .state import (
    CameraState as CameraState,
    State as State,
    decode_state as decode_state,
    encode_state as encode_state,
)
from .status import (
    Pace as Pace,
    Status as Status,
    decode_status as decode_status,
    encode_status as encode_status,
)
from .stream import StreamInfo as StreamInfo
from .topics import (
    CAMERA_INFO as CAMERA_INFO,
    CLOCK as CLOCK,
    DEFAULT_ADDRESS as DEFAULT_ADDRESS,
    EVENTS as EVENTS,
    FRAMES as FRAMES,
    IMU as IMU,
    LIGHT as LIGHT,
    POSE as POSE,
    STATE_PREFIX as STATE_PREFIX,
    STATUS as STATUS,
    TOPICS as TOPICS,
    TRUTH as TRUTH,
    Topic as Topic,
)
from .trigger import (
    TRIGGER_DTYPE as TRIGGER_DTYPE,
    Trigger as Trigger,
    TriggerPacket as TriggerPacket,
    Triggers as Triggers,
    empty_triggers as empty_triggers,
    external_triggers as external_triggers,
    frame_triggers as frame_triggers,
    make_triggers as make_triggers,
)
