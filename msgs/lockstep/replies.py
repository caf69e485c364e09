"""What the server of a closed loop says: `header | ...`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from evs.msgs.errors import EvsError
from evs.msgs.event import EVENT_DTYPE, Events, clean_events, empty_events
from evs.msgs.fields import MAX_INT64, MessageError, boolean, integer
from evs.msgs.frame import decode_frame, encode_frame
from evs.msgs.imu import decode_imu, encode_imu
from evs.msgs.lockstep.common import F64, Parts, floats, line_of
from evs.msgs.observation import Observation
from evs.msgs.packet import EventPacket, check_events, packb

PACKET_COLUMNS = ("camera", "seq", "time_base", "time_end", "events")
"""A row of the table of packets, int64: place of the camera, seq, us, us, how many events."""

_BESIDE = ("frames", "imu")
_ROW = len(PACKET_COLUMNS)
_ITEM = EVENT_DTYPE.itemsize


def encode_error(number: int, line: str) -> Parts:
    """Frames of the answer to what cannot be done."""
    return [packb({"ok": False, "number": number, "error": " ".join(line.split())[:4000]})]


def encode_told(number: int, told: Mapping[str, Any], *raw: Any) -> Parts:
    """Frames of an answer of plain values (and what else there is to it)."""
    return [packb({"ok": True, "number": number, **told}), *raw]


def decode_answer(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of an answer; its error is raised as an EvsError of that line."""
    if boolean(fields, "ok"):
        return fields
    raise EvsError(line_of(fields, "error"))


def encode_seen(
    number: int, seen: Observation, encoders: F64, places: Mapping[str, int], state: F64 | None
) -> Parts:
    """Frames of what is seen: header, encoders, table of packets, events, and what else there is.

    In: encoders (2, n) position and velocity; places,
    camera -> its place among those that the controller sees.
    """
    mine = [packet for packet in seen.packets if packet.camera in places]
    rows = [
        (places[one.camera], one.seq, one.time_base_us, one.time_end_us, len(one.events))
        for one in mine
    ]
    table = np.array(rows, "<i8").tobytes() if rows else b""
    full = [clean_events(one.events).view(np.uint8).data for one in mine if len(one.events)]
    header = {"ok": True, "number": number, "t": int(seen.t_us), "done": seen.done}
    more: Parts = []
    if state is not None:
        header["state"] = True
        more.append(np.ascontiguousarray(state, "<f8").tobytes())
    if seen.frames or seen.imu:
        frames = [encode_frame(one) for one in seen.frames if one.camera in places]
        imu = [encode_imu(one) for one in seen.imu if one.camera in places]
        header |= {"frames": len(frames), "imu": len(imu)}
        more += [part for one in (*frames, *imu) for part in one]
    # a lone packet is sent from where it lies
    events = full[0] if len(full) == 1 else b"".join(full)
    return [packb(header), np.ascontiguousarray(encoders, "<f8").tobytes(), table, events, *more]


def decode_seen(
    fields: dict[str, Any],
    raw: Sequence[Any],
    actuators: int,
    cameras: Sequence[tuple[str, int, int]],
) -> Observation:
    """What is seen, from the frames after the header. Raises MessageError.

    In: cameras, (name, width, height) of each. Arrays share the frames' memory and cannot be
    written.
    """
    with_state = "state" in fields
    frames, imu = (integer(fields, key, 0, len(raw)) if key in fields else 0 for key in _BESIDE)
    wanted = 3 + with_state + 2 * (frames + imu)
    if len(raw) != wanted:
        raise MessageError(f"what is seen has {wanted} frames after its header, not {len(raw)}")
    encoders = floats(raw[0], "encoders")
    if len(encoders) != 2 * actuators:
        raise MessageError(f"{len(encoders)} numbers of encoders for {actuators} actuators")
    rest = [raw[i : i + 2] for i in range(3 + with_state, len(raw), 2)]
    return Observation(
        t_us=integer(fields, "t", -MAX_INT64, MAX_INT64),
        done=line_of(fields, "done"),
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
