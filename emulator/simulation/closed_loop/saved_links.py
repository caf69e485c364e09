"""Links as named arrays: what is on its way when a loop is saved.

Messages are stored as they travel on the bus, so that whoever takes them back checks them as he
would check what comes from there.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from evs.emulator.simulation.closed_loop.link import OnTheWay
from evs.emulator.state import MOST, Saved
from evs.msgs import (
    LABEL_DTYPE,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    decode,
    decode_frame,
    decode_imu,
    encode,
    encode_frame,
    encode_imu,
)

Message = EventPacket | Frame | ImuPacket

DECODERS: dict[str, Any] = {"packets": decode, "frames": decode_frame, "imu": decode_imu}
"""stream -> what reads its messages"""


def save_waiting(waiting: deque[OnTheWay[Message]]) -> Saved:
    """Named arrays that `read_waiting` takes back."""
    parts = [_parts(one.message) for one in waiting]
    times = [(one.sent_us, one.arrives_us) for one in waiting]
    sizes = [[len(piece) for piece in three] for three in parts]
    raw = b"".join(piece for three in parts for piece in three)
    return {
        "times": np.array(times, np.int64).reshape(-1, 2),
        "sizes": np.array(sizes, np.int64).reshape(-1, 3),
        "bytes": np.frombuffer(raw, np.uint8),
    }


def read_waiting(saved: Saved, stream: str, camera: str) -> deque[OnTheWay[Any]]:
    """What was on its way, in a stream of a camera. Raises EvsError."""
    times, sizes, raw = (saved[name] for name in ("times", "sizes", "bytes"))
    if (
        (times.shape, sizes.shape) != ((len(times), 2), (len(times), 3))
        or (sizes < 0).any()
        or (sizes > raw.size).any()
        or sizes.sum() != raw.size
        or (times[:, 1] < times[:, 0]).any()
        or (np.diff(times, axis=0) < 0).any()
        or (np.abs(times) > MOST).any()
    ):
        raise EvsError(f"saved state is damaged: its {stream} is invalid; save it again")
    pieces, place = [], 0
    for size in sizes.ravel().tolist():
        # each has memory of its own
        pieces.append(raw[place : place + size].tobytes())
        place += size
    found: deque[OnTheWay[Any]] = deque()
    for number, (sent_us, arrives_us) in enumerate(times.tolist()):
        header, body, labels = pieces[3 * number : 3 * number + 3]
        message = _message(stream, header, bytearray(body), labels)
        if message.camera != camera:
            raise EvsError(f"saved state is damaged: its {stream} is invalid; save it again")
        found.append(OnTheWay(sent_us, arrives_us, message))
    return found


def _parts(message: Message) -> tuple[bytes, bytes, bytes]:
    """Header, body and labels; these do not travel on the bus."""
    if isinstance(message, EventPacket):
        header, body = encode(message)
        labels = b"" if message.labels is None else b"l" + message.labels.tobytes()
        return header, bytes(body), labels
    header, body = encode_frame(message) if isinstance(message, Frame) else encode_imu(message)
    return header, bytes(body), b""


def _message(stream: str, header: bytes, body: bytearray, labels: bytes) -> Any:
    message = DECODERS[stream](header, body)
    if labels and stream == "packets":
        kept = bytearray(labels[1:])
        if len(kept) != len(message) * LABEL_DTYPE.itemsize:
            raise EvsError("saved state is damaged: labels are invalid; save it again")
        fields = {name: getattr(message, name) for name in EventPacket.__dataclass_fields__}
        return EventPacket(**{**fields, "labels": np.frombuffer(kept, LABEL_DTYPE)})
    return message
