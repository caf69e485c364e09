"""Replies of the server of a closed loop: `header | ...`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from evs.msgs.errors import EvsError
from evs.msgs.event import EVENT_DTYPE, Events, clean_events, empty_events
from evs.msgs.frame import decode_frame, encode_frame
from evs.msgs.header_fields import MAX_INT64, MessageError, boolean, integer
from evs.msgs.imu import decode_imu, encode_imu
from evs.msgs.lockstep.common import F64, Parts, floats, text_field
from evs.msgs.observation import Observation
from evs.msgs.packet import EventPacket, check_events, packb

PACKET_COLUMNS = ("camera", "seq", "time_base", "time_end", "events")
"""Columns of the table of packets, int64: index of the camera, seq, us, us, number of events."""

_AUXILIARY = ("frames", "imu")
_ROW = len(PACKET_COLUMNS)
_ITEM = EVENT_DTYPE.itemsize


def encode_error(number: int, line: str) -> Parts:
    """The frames of the reply to a request that failed, with a one-line message."""
    return [packb({"ok": False, "number": number, "error": " ".join(line.split())[:4000]})]


def encode_reply(number: int, fields: Mapping[str, Any], *raw: Any) -> Parts:
    """The frames of a reply with plain values in its header, and raw frames."""
    return [packb({"ok": True, "number": number, **fields}), *raw]


def decode_reply(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a reply's header.

    Raises:
        EvsError: The request failed; the message is the server's.
    """
    if boolean(fields, "ok"):
        return fields
    raise EvsError(text_field(fields, "error"))


def encode_observation(
    number: int,
    observation: Observation,
    encoders: F64,
    places: Mapping[str, int],
    state: F64 | None,
) -> Parts:
    """Encode an observation for one controller.

    Args:
        number: Number of the request.
        observation: What all cameras gave.
        encoders: (2, n) float64, position and velocity of each actuator.
        places: Camera -> its index among those that the controller sees.
        state: (m,) float64 state of the simulation; None: not requested.

    Returns:
        The frames: header, encoders, table of packets, events, then the state, intensity frames
        and IMU samples where there are any.
    """
    mine = [packet for packet in observation.packets if packet.camera in places]
    rows = [
        (places[one.camera], one.seq, one.time_base_us, one.time_end_us, len(one.events))
        for one in mine
    ]
    table = np.array(rows, "<i8").tobytes() if rows else b""
    full = [clean_events(one.events).view(np.uint8).data for one in mine if len(one.events)]
    header = {"ok": True, "number": number, "t": int(observation.t_us), "done": observation.done}
    more: Parts = []
    if state is not None:
        header["state"] = True
        more.append(np.ascontiguousarray(state, "<f8").tobytes())
    if observation.frames or observation.imu:
        frames = [encode_frame(one) for one in observation.frames if one.camera in places]
        imu = [encode_imu(one) for one in observation.imu if one.camera in places]
        header |= {"frames": len(frames), "imu": len(imu)}
        more += [part for one in (*frames, *imu) for part in one]
    # a single packet is sent without a copy
    events = full[0] if len(full) == 1 else b"".join(full)
    return [packb(header), np.ascontiguousarray(encoders, "<f8").tobytes(), table, events, *more]


def decode_observation(
    fields: dict[str, Any],
    raw: Sequence[Any],
    actuators: int,
    cameras: Sequence[tuple[str, int, int]],
) -> Observation:
    """Decode an observation.

    Args:
        fields: The fields of the header.
        raw: The frames after the header.
        actuators: Number of actuators.
        cameras: (name, width, height) of each camera.

    Returns:
        The observation. Its arrays share the frames' memory and are read-only.

    Raises:
        MessageError: The frames do not fit the format.
    """
    with_state = "state" in fields
    frames, imu = (integer(fields, key, 0, len(raw)) if key in fields else 0 for key in _AUXILIARY)
    wanted = 3 + with_state + 2 * (frames + imu)
    if len(raw) != wanted:
        raise MessageError(f"an observation has {wanted} frames after its header, not {len(raw)}")
    encoders = floats(raw[0], "encoders")
    if len(encoders) != 2 * actuators:
        raise MessageError(f"{len(encoders)} numbers of encoders for {actuators} actuators")
    rest = [raw[i : i + 2] for i in range(3 + with_state, len(raw), 2)]
    return Observation(
        t_us=integer(fields, "t", -MAX_INT64, MAX_INT64),
        done=text_field(fields, "done"),
        position=encoders[:actuators],
        velocity=encoders[actuators:],
        packets=_packets(raw[1], raw[2], cameras),
        state=floats(raw[3], "state") if with_state else None,
        frames=tuple(decode_frame(*pair) for pair in rest[:frames]),
        imu=tuple(decode_imu(*pair) for pair in rest[frames:]),
    )


def _packets(
    table: Any, raw: Any, cameras: Sequence[tuple[str, int, int]]
) -> tuple[EventPacket, ...]:
    if len(table) % (8 * _ROW) or len(raw) % _ITEM:
        raise MessageError("the table of packets or the events are not whole")
    events: Events = np.frombuffer(raw, EVENT_DTYPE) if len(raw) else empty_events()
    found, begin = [], 0
    for place, seq, base_us, end_us, count in (
        np.frombuffer(table, "<i8").reshape(-1, _ROW).tolist()
    ):
        if not (0 <= place < len(cameras) and seq >= 0 and end_us >= base_us and count >= 0):
            raise MessageError(f"a row of the table of packets is {(place, seq, base_us, end_us)}")
        camera, width, height = cameras[place]
        mine = events[begin : begin + count]
        if len(mine) < count:
            raise MessageError(f"{len(events)} events are fewer than the table of packets says")
        begin += count
        sizes = {"time_base": base_us, "time_end": end_us, "width": width, "height": height}
        check_events(mine, sizes)
        found.append(EventPacket(seq, base_us, end_us, width, height, mine, camera))
    if begin != len(events):
        raise MessageError(f"{len(events)} events are more than the table of packets says")
    return tuple(found)
