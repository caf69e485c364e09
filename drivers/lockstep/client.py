"""A controller's end: the methods of evs.ClosedLoop, over the wire."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.bus.address import connectable
from evs.drivers.bus.curve_keys import read_public, read_secret
from evs.drivers.bus.exchange import ClientEnd
from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError, MessageError, Observation, StreamInfo
from evs.msgs.header_fields import MAX_INT64, check_name, integer
from evs.msgs.lockstep import (
    F64,
    LOCKSTEP_ADDRESS,
    MAX_BLOB_BYTES,
    MAX_TICKS,
    Bye,
    Join,
    Request,
    Reset,
    Restore,
    Save,
    Step,
    decode_header,
    decode_observation,
    decode_reply,
    decode_stream,
    encode_request,
    floats,
    names_field,
)

_AGAIN_S = 1.0
"""A request without an answer is sent again after this, then after twice as long, and so on: the
server does nothing twice, but sends its answer again."""
_BYE_S = 0.2
_MARGIN_BYTES = 1 << 20


def connect(
    address: str = LOCKSTEP_ADDRESS,
    name: str = "controller",
    *,
    actuators: Sequence[str] | None = None,
    cameras: Sequence[str] | None = None,
    timeout_s: float = 30.0,
    server_key: str = "",
    key: str = "",
) -> RemoteLoop:
    """Join a closed loop in another process.

    Args:
        address: Address of the server: tcp://HOST:PORT or ipc:///PATH.
        name: Name of this controller, which must be unique.
        actuators: The actuators it controls, in the order of its controls; None: all.
        cameras: The cameras to receive; None: all.
        timeout_s: Time to wait for an answer, and for the server to appear, s.
        server_key: The server's public key, if it has one.
        key: File of this controller's secret key, if the server accepts only listed keys.

    Returns:
        The loop, joined.

    Raises:
        EvsError: No server answers, no seat is free, or a name is unknown.
    """
    return RemoteLoop(
        address,
        name,
        actuators=actuators,
        cameras=cameras,
        timeout_s=timeout_s,
        server_key=server_key,
        key=key,
    )


class RemoteLoop:
    """A closed loop in another process. Use it in one thread; close it, or use `with`.

        with evs.connect("tcp://127.0.0.1:5570") as loop:
            seen = loop.reset(seed=1)
            while not seen.done:
                seen = loop.step(controller(seen))

    Its arrays are read-only. Every method raises EvsError if the server rejects the request, does
    not answer within `timeout_s`, or has ended.
    """

    def __init__(
        self,
        address: str = LOCKSTEP_ADDRESS,
        name: str = "controller",
        *,
        actuators: Sequence[str] | None = None,
        cameras: Sequence[str] | None = None,
        timeout_s: float = 30.0,
        server_key: str = "",
        key: str = "",
    ) -> None:
        if not isinstance(timeout_s, int | float) or not timeout_s > 0:
            raise EvsError(f"timeout_s is {timeout_s!r}: give seconds, over 0")
        if key and not server_key:
            raise EvsError("key needs server_key: give the server's public key")
        check_name(name, "name of the controller")
        public = read_public(server_key, "server_key") if server_key else ""
        own = read_secret(key) if key else None
        self.address, self.name, self.timeout_s = address, name, timeout_s
        self._number = 0
        self._has_keys = bool(public)
        wanted = Join(name, _names(actuators, "actuators"), _names(cameras, "cameras"))
        self._end: ClientEnd | None = None
        self._end = ClientEnd(connectable(address), public, own, MAX_BLOB_BYTES + _MARGIN_BYTES)
        try:
            described, raw = self._ask(wanted)
            if len(raw) != 1:
                raise MessageError(f"an answer of {1 + len(raw)} frames to a join, not 2")
            self.tick_us = integer(described, "tick_us", 1, 2**62)
            """length of a tick, us"""
            self.actuators = names_field(described, "actuators") or ()
            """names of the actuators that are this controller's, in the order of its controls"""
            self.cameras: tuple[StreamInfo, ...] = _streams(described)
            """what is constant of each camera that it sees"""
            self.ctrl_range: F64 = floats(raw[0], "ctrl_range").reshape(-1, 2)
            """(nu, 2) lowest and highest control of each actuator"""
        except BaseException:
            self._release()
            raise
        self._shapes = [(one.camera, one.width, one.height) for one in self.cameras]
        self.t_us = 0
        """simulated time of the last answer, us"""
        self.done = ""
        """why the episode is over; "": it goes on, or has not begun"""

    @property
    def nu(self) -> int:
        """Number of controls of this controller."""
        return len(self.actuators)

    def reset(
        self, seed: int | None = None, keyframe: str = "", state: bool = False
    ) -> Observation:
        """Begin an episode once every controller has requested it; see evs.ClosedLoop.reset."""
        if seed is not None and not (isinstance(seed, int) and abs(seed) <= MAX_INT64):
            raise EvsError(
                f"seed is {seed!r}: give an integer of 64 bits, or None to keep the last"
            )
        return self._seen(Reset(seed, str(keyframe), bool(state)))

    def step(self, ctrl: npt.ArrayLike | None = None, ticks: int = 1) -> Observation:
        """Send a control, and wait for all controllers and the ticks.

        Args:
            ctrl: (nu,) controls of this controller's actuators; None keeps the last.
            ticks: Number of ticks.

        Returns:
            The next observation.
        """
        if type(ticks) is not int or not 1 <= ticks <= MAX_TICKS:
            raise EvsError(f"ticks is {ticks!r}: a step is 1 ... {MAX_TICKS} ticks")
        return self._seen(Step(ticks, None if ctrl is None else self._checked(ctrl)))

    def save(self, compress: bool = False) -> bytes:
        """Return the whole loop as bytes; see evs.ClosedLoop.save."""
        _, raw = self._ask(Save(bool(compress)))
        if len(raw) != 1:
            raise MessageError(f"a saved loop came in {len(raw)} frames, not 1")
        return bytes(raw[0])

    def restore(self, blob: bytes) -> Observation:
        """Return to a saved state, once every controller requests it; see ClosedLoop.restore."""
        if not isinstance(blob, bytes | bytearray | memoryview) or not blob:
            raise EvsError("these are no bytes of a saved state: give what save() gave")
        return self._seen(Restore(bytes(blob)))

    def close(self) -> None:
        """Leave the loop. Safe to call twice."""
        if self._end is None:
            return
        with suppress(EvsError):
            # a good-bye that does not arrive costs nobody more than the closed connection does
            self._number += 1
            if not self._end.gone and self._end.ask(encode_request(self._number, Bye())):
                self._await(self._number, [], monotonic_s() + _BYE_S)
        self._release()

    def _checked(self, ctrl: npt.ArrayLike) -> F64:
        try:
            values = np.asarray(ctrl, np.float64)
        except (TypeError, ValueError):
            raise EvsError(f"step(ctrl): {ctrl!r} are no numbers") from None
        if values.shape != (self.nu,):
            raise EvsError(
                f"step(ctrl) takes {self.nu} numbers, one for each of {list(self.actuators)}, "
                f"not shape {values.shape}"
            )
        return values

    def _seen(self, request: Request) -> Observation:
        fields, raw = self._ask(request)
        seen = decode_observation(fields, raw, self.nu, self._shapes)
        self.t_us, self.done = seen.t_us, seen.done
        return seen

    def _ask(self, request: Request) -> tuple[dict[str, Any], list[Any]]:
        """Send a request; return the fields and the further frames of the answer."""
        self._number += 1
        parts = encode_request(self._number, request)
        return self._await(self._number, parts, monotonic_s() + self.timeout_s)

    def _await(
        self, number: int, parts: list[Any], until_s: float
    ) -> tuple[dict[str, Any], list[Any]]:
        """Send a request, again where it may be lost, and wait for its answer."""
        if self._end is None:
            raise EvsError("this connection is closed: connect again")
        again_s, gap_s = 0.0, _AGAIN_S
        if parts and self._end.ask(parts):
            again_s = monotonic_s() + gap_s
        while True:
            came = self._end.receive()
            if came:
                answered, fields = decode_header(came[0])
                # the answer to a request that was given up, or to one sent twice
                if answered == number or answered == 0:
                    return decode_reply(fields), came[1:]
                continue
            now_s = monotonic_s()
            if self._end.refused:
                raise EvsError(self._refusal())
            if self._end.gone:
                raise EvsError(f"the server at {self.address} has gone")
            if now_s >= until_s:
                raise EvsError(self._silence(number))
            if parts and now_s >= again_s and self._end.ask(parts):
                gap_s *= 2
                again_s = now_s + gap_s

    def _silence(self, number: int) -> str:
        if number == 1:
            return (
                f"nobody serves a closed loop at {self.address} (waited {self.timeout_s:g} s): "
                "start evs emulate ... --pace lockstep"
            )
        return (
            f"no answer from {self.address} within {self.timeout_s:g} s: it is busy, waits for "
            "another controller, or is gone; give a longer timeout_s"
        )

    def _refusal(self) -> str:
        if self._has_keys:
            why = "server_key is not its public key, or it does not allow yours, or it has no keys"
        else:
            why = "it wants keys (give server_key, its public key), or it is no server of a loop"
        return f"the program at {self.address} does not let us in: {why}"

    def _release(self) -> None:
        if self._end is not None:
            self._end.close()
            self._end = None

    def __enter__(self) -> RemoteLoop:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _names(names: Sequence[str] | None, what: str) -> tuple[str, ...] | None:
    if names is None:
        return None
    if isinstance(names, str):
        raise EvsError(f"{what} takes several names, as in {what}=('{names}',)")
    for one in names:
        check_name(one, f"a name in {what}")
    return tuple(names)


def _streams(described: dict[str, Any]) -> tuple[StreamInfo, ...]:
    """The cameras of a join's answer."""
    try:
        return tuple(decode_stream(one) for one in described["cameras"])
    except (KeyError, TypeError) as reason:
        raise MessageError(f"the server's cameras cannot be understood: {reason!r}") from None
