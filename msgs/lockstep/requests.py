"""Requests of a controller: `header | body`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.msgs.errors import unknown
from evs.msgs.header_fields import (
    MAX_INT64,
    MessageError,
    boolean,
    check_name,
    integer,
    name,
    shown,
)
from evs.msgs.lockstep.common import (
    F64,
    LOCKSTEP_PROTOCOL,
    MAX_BLOB_BYTES,
    MAX_TICKS,
    Parts,
    floats,
    names_field,
    text_field,
)
from evs.msgs.packet import packb


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
