"""Lock-step: what controllers and the server of a closed loop say to each other.

Byte by byte in docs/reference/lockstep.md. The hot pair, step and what is seen, has a header of a
few bytes and raw frames.
"""

from evs.msgs.lockstep.answers import (
    PACKET_COLUMNS,
    decode_answer,
    decode_seen,
    encode_error,
    encode_seen,
    encode_told,
)
from evs.msgs.lockstep.common import (
    LOCKSTEP_ADDRESS,
    LOCKSTEP_PROTOCOL,
    MAX_BLOB_BYTES,
    MAX_TICKS,
    MOST_NAMES,
    Parts,
    number_of,
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
    "MAX_TICKS",
    "MOST_NAMES",
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
    "decode_answer",
    "decode_request",
    "decode_seen",
    "encode_error",
    "encode_request",
    "encode_seen",
    "encode_told",
    "number_of",
]
