"""Lock-step: the messages between controllers and the server of a closed loop.

docs/reference/lockstep.md describes them byte by byte. The pair of every tick, step and
observation, has a header of a few bytes and raw frames.
"""

from evs.msgs.lockstep.common import (
    LOCKSTEP_ADDRESS,
    LOCKSTEP_PROTOCOL,
    MAX_BLOB_BYTES,
    MAX_NAMES,
    MAX_TICKS,
    Parts,
    decode_header,
)
from evs.msgs.lockstep.replies import (
    PACKET_COLUMNS,
    decode_observation,
    decode_reply,
    encode_error,
    encode_observation,
    encode_reply,
)
from evs.msgs.lockstep.requests import (
    Bye,
    Hello,
    Join,
    Request,
    Reset,
    Restore,
    Save,
    Step,
    decode_request,
    encode_request,
)

__all__ = [
    "LOCKSTEP_ADDRESS",
    "LOCKSTEP_PROTOCOL",
    "MAX_BLOB_BYTES",
    "MAX_NAMES",
    "MAX_TICKS",
    "PACKET_COLUMNS",
    "Bye",
    "Hello",
    "Join",
    "Parts",
    "Request",
    "Reset",
    "Restore",
    "Save",
    "Step",
    "decode_header",
    "decode_observation",
    "decode_reply",
    "decode_request",
    "encode_error",
    "encode_observation",
    "encode_reply",
    "encode_request",
]
