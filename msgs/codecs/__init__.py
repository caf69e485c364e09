"""Event encodings of cameras and of ROS, in NumPy, from arrays to bytes and back."""

from evs.msgs.codecs.codec import Codec, Payload
from evs.msgs.codecs.dat import MAX_SIDE_DAT_PX, DatState, decode_dat, encode_dat
from evs.msgs.codecs.evt2 import (
    Evt2State,
    Evt21State,
    decode_evt2,
    decode_evt21,
    encode_evt2,
    encode_evt21,
)
from evs.msgs.codecs.evt3 import Evt3State, decode_evt3, encode_evt3
from evs.msgs.codecs.limits import (
    LAST_ROS_US,
    LONGEST_US,
    MAX_SIDE_EVT_PX,
    TIME_ORIGIN_US,
    EncodingLimits,
    check_fits,
)
from evs.msgs.codecs.payloads import PAYLOADS, PayloadReader, PayloadWriter

__all__ = [
    "LAST_ROS_US",
    "LONGEST_US",
    "MAX_SIDE_DAT_PX",
    "MAX_SIDE_EVT_PX",
    "PAYLOADS",
    "TIME_ORIGIN_US",
    "Codec",
    "DatState",
    "EncodingLimits",
    "Evt2State",
    "Evt3State",
    "Evt21State",
    "Payload",
    "PayloadReader",
    "PayloadWriter",
    "check_fits",
    "decode_dat",
    "decode_evt2",
    "decode_evt3",
    "decode_evt21",
    "encode_dat",
    "encode_evt2",
    "encode_evt3",
    "encode_evt21",
]
