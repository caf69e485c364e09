"""Lock-step: the messages between controllers and the server of a closed loop.

docs/reference/lockstep.md describes them byte by byte: requests of a controller, `header | body`,
and replies of the server, `header | ...`. The pair of every tick, step and observation, has a
header of a few bytes and raw frames.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.errors import EvsError, unknown
from evs.msgs.event import EVENT_DTYPE, Events, clean_events, empty_events
from evs.msgs.frame import decode_frame, encode_frame
from evs.msgs.header_fields import (
    MAX_INT64,
    MessageError,
    boolean,
    check_name,
    integer,
    name,
    shown,
)
from evs.msgs.imu import decode_imu, encode_imu
from evs.msgs.observation import Observation
from evs.msgs.packet import MAX_HEADER_BYTES, EventPacket, check_events, packb, unpackb
from evs.msgs.stream import StreamInfo

F64 = npt.NDArray[np.float64]

LOCKSTEP_ADDRESS = "tcp://127.0.0.1:5570"
"""Default address of the server of a closed loop."""

LOCKSTEP_PROTOCOL = 1
"""Version of the protocol; a client of another version is refused."""

MAX_BLOB_BYTES = 1 << 30
"""Largest saved state in a message."""

MAX_TICKS = 1_000_000
"""Most ticks of one step."""

MAX_NAMES = 1000
"""Most actuators or cameras: lists in a header have no more items."""

Parts = list[Any]
"""Frames of a message: bytes or contiguous buffers."""


def decode_header(header: bytes) -> tuple[int, dict[str, Any]]:
    """The number of a message and all fields of its header. MessageError: it is not ours."""
    fields = unpackb(header, MAX_HEADER_BYTES)
    return integer(fields, "number", 0, MAX_INT64), fields


def text_field(fields: dict[str, Any], key: str) -> str:
    """A field that holds a short text, which may be empty."""
    value = fields.get(key)
    if not isinstance(value, str):
        raise MessageError(f"header field {key!r} is {shown(value)}, not a text")
    return value


def names_field(fields: dict[str, Any], key: str) -> tuple[str, ...] | None:
    """A field that holds a list of names; None where it is missing."""
    found = fields.get(key)
    if found is None:
        return None
    if not isinstance(found, list):
        raise MessageError(f"header field {key!r} is {shown(found)}, not a list of names")
    for one in found:
        check_name(one, f"a name in header field {key!r}")
    return tuple(found)


def floats(raw: Any, what: str) -> F64:
    """The float64 numbers of a raw frame."""
    if len(raw) % 8:
        raise MessageError(f"{what}: {len(raw)} bytes are not whole float64 numbers")
    return np.frombuffer(raw, "<f8")


@dataclass(frozen=True)
class Hello:
    """Ask for a description of the loop; also answered before joining."""


@dataclass(frozen=True)
class Join:
    """Join the loop as a controller."""

    name: str
    actuators: tuple[str, ...] | None = None
    """actuators that it owns, in the order of its controls; None: all"""
    cameras: tuple[str, ...] | None = None
    """cameras that it wants to see; None: all"""


@dataclass(frozen=True)
class Reset:
    """Start an episode."""

    seed: int | None = None
    """None: the last one"""
    keyframe: str = ""
    state: bool = False
    """whether this controller wants the state in every reply of the episode"""


@dataclass(frozen=True, eq=False)
class Step:
    """Set the controls and simulate some ticks."""

    ticks: int
    ctrl: F64 | None
    """(n,) finite, for the actuators it owns; None: keep the controls"""


@dataclass(frozen=True)
class Save:
    """Save the state of the whole loop."""

    compress: bool = False


@dataclass(frozen=True, eq=False)
class Restore:
    """Restore a saved state."""

    blob: bytes


@dataclass(frozen=True)
class Bye:
    """Leave the loop."""


Request = Hello | Join | Reset | Step | Save | Restore | Bye
"""Any request."""


def encode_request(number: int, request: Request) -> Parts:
    """The frames of a request: header, and a body where it has one."""
    kind = _NAMES[type(request)]
    fields: dict[str, Any] = {"request": kind, "number": number}
    if isinstance(request, Step):
        fields["ticks"] = request.ticks
        ctrl = b"" if request.ctrl is None else np.ascontiguousarray(request.ctrl, "<f8").tobytes()
        return [packb(fields), ctrl]
    if isinstance(request, Join):
        fields |= {"protocol": LOCKSTEP_PROTOCOL, "name": request.name}
        for key, names in (("actuators", request.actuators), ("cameras", request.cameras)):
            fields |= {} if names is None else {key: list(names)}
    elif isinstance(request, Reset):
        fields |= {"seed": request.seed, "keyframe": request.keyframe, "state": request.state}
    elif isinstance(request, Save):
        fields["compress"] = request.compress
    elif isinstance(request, Restore):
        if len(request.blob) > MAX_BLOB_BYTES:
            raise MessageError(f"a saved state of {len(request.blob)} bytes is over 1 GiB")
        return [packb(fields), request.blob]
    return [packb(fields)]


def decode_request(fields: dict[str, Any], body: Any = b"") -> Request:
    """Decode a request from its header's fields and its body.

    Raises:
        MessageError: The request is unknown, or its fields do not fit the format.
    """
    kind = fields.get("request")
    decoder = _DECODERS.get(kind) if isinstance(kind, str) else None
    if decoder is None:
        shown_kind = kind[:60] if isinstance(kind, str) else shown(kind)
        raise MessageError(str(unknown("request", shown_kind, _DECODERS)))
    if body is not None and len(body) and kind not in ("step", "restore"):
        raise MessageError(f"a {kind} request has no second frame, this has {len(body)} bytes")
    return decoder(fields, body)


def _step(fields: dict[str, Any], body: Any) -> Step:
    ticks = fields.get("ticks")
    # the plain case first: this runs at every tick
    if type(ticks) is not int or not 1 <= ticks <= MAX_TICKS:
        ticks = integer(fields, "ticks", 1, MAX_TICKS)
    if body is None or not len(body):
        return Step(ticks, None)
    ctrl = floats(body, "ctrl")
    if not np.isfinite(ctrl).all():
        place = int(np.flatnonzero(~np.isfinite(ctrl))[0])
        raise MessageError(f"ctrl[{place}] is {ctrl[place]}: controls are finite numbers")
    return Step(ticks, ctrl)


def _join(fields: dict[str, Any], _: Any) -> Join:
    protocol = integer(fields, "protocol", 0, MAX_INT64)
    if protocol != LOCKSTEP_PROTOCOL:
        raise MessageError(
            f"protocol {protocol} is not supported, only {LOCKSTEP_PROTOCOL}: "
            "use the same evs at both ends"
        )
    called = name(fields, "name")
    return Join(called, names_field(fields, "actuators"), names_field(fields, "cameras"))


def _reset(fields: dict[str, Any], _: Any) -> Reset:
    seed = None if fields.get("seed") is None else integer(fields, "seed", -MAX_INT64, MAX_INT64)
    keyframe = text_field(fields, "keyframe")
    if keyframe:
        check_name(keyframe, "header field 'keyframe'")
    return Reset(seed, keyframe, boolean(fields, "state"))


def _restore(_: dict[str, Any], body: Any) -> Restore:
    if body is None or not len(body):
        raise MessageError("a restore request has the saved bytes in a second frame")
    return Restore(bytes(body))


_NAMES: dict[type[Any], str] = {
    Hello: "hello",
    Join: "join",
    Reset: "reset",
    Step: "step",
    Save: "save",
    Restore: "restore",
    Bye: "bye",
}
_DECODERS: dict[str, Callable[[dict[str, Any], Any], Request]] = {
    "hello": lambda _fields, _body: Hello(),
    "join": _join,
    "reset": _reset,
    "step": _step,
    "save": lambda fields, _body: Save(boolean(fields, "compress")),
    "restore": _restore,
    "bye": lambda _fields, _body: Bye(),
}


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


_STREAM_FIELDS = ("camera", "width", "height", "sensor", "tick_us", "seed", "latency_us")


def stream_fields(stream: StreamInfo) -> dict[str, Any]:
    """Return what a description says of one camera, as plain values of a header."""
    plain = {key: getattr(stream, key) for key in _STREAM_FIELDS}
    return {**plain, "frames": stream.frames, "imu": stream.imu}


def decode_stream(described: dict[str, Any]) -> StreamInfo:
    """Return a camera of a description."""
    plain = {key: described[key] for key in _STREAM_FIELDS}
    return StreamInfo(**plain, frames=described["frames"], imu=described["imu"])
