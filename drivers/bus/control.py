"""The control port of a publisher, both ends: it describes the publisher and takes requests.

A request is a msgpack map {"request": NAME}. The answer is a map with "ok" and either the result or
"error", a line (docs/reference/wire.md). The server is a ROUTER, which works with REQ clients. The
thread that publishes polls it; it never waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import zmq

from evs.drivers.bus.address import connectable, is_ipc, is_ipv6
from evs.drivers.bus.curve_keys import new_keys, present, read_public, read_secret
from evs.drivers.bus.sockets import Context, Socket, readable, receive_parts
from evs.msgs import EvsError, MessageError, unknown
from evs.msgs.header_fields import boolean, integer, shown
from evs.msgs.packet import packb, unpackb

PROTOCOL = 1
"""Version of this protocol; a client of another one should not guess."""

MAX_REQUEST_BYTES = 4096
"""Longest request."""

MAX_RECEIVED_BYTES = 16 * MAX_REQUEST_BYTES
"""Longest message that is received, to be refused; a longer one ends its connection."""

MAX_ANSWER_BYTES = 1024 * 1024
"""Longest answer."""

_MOST_AT_ONCE = 8
"""Requests answered at one poll: the others wait, the camera does not."""

Answer = dict[str, Any]


class Control:
    """Answers requests by a table of functions."""

    def __init__(
        self, server: Socket, requests: dict[str, Callable[[dict[str, Any]], Answer]]
    ) -> None:
        """Serve a socket.

        Args:
            server: A bound ROUTER.
            requests: Name of a request -> function of the request's map that returns its answer, or
                raises EvsError.
        """
        self.answered = 0
        """Number of requests, refused ones too."""
        self._server, self._requests = server, requests

    def poll(self) -> None:
        """Answer the requests that wait, a few at a time."""
        for _ in range(_MOST_AT_ONCE):
            if not readable(self._server):
                return
            identity, *frames = receive_parts(self._server)
            # the empty part that REQ puts in and DEALER may leave out
            envelope = [identity, *frames[:-1][:1]] if frames[:1] == [b""] else [identity]
            try:
                answer = packb({"ok": True, **self._answer(frames, envelope)}, MAX_ANSWER_BYTES)
            except EvsError as reason:
                answer = packb({"ok": False, "error": " ".join(str(reason).split())})
            self.answered += 1
            # to a client that has gone, or does not read, it is dropped
            self._server.send_multipart([*envelope, answer], zmq.NOBLOCK)

    def _answer(self, frames: list[Any], envelope: list[bytes]) -> Answer:
        request = frames[len(envelope) - 1 :]
        if len(request) != 1:
            raise MessageError("a request is one frame; this one has more")
        fields = unpackb(bytes(request[0]), MAX_REQUEST_BYTES)
        name = fields.get("request")
        if not isinstance(name, str):
            raise MessageError(f"field 'request' is {shown(name)}, not a name")
        if name not in self._requests:
            raise unknown("request", name[:60], self._requests)
        return self._requests[name](fields)


_WILDCARDS = ("0.0.0.0", "[::]", "*")


@dataclass(frozen=True)
class Described:
    """A publisher's description of itself."""

    address: str
    """Where its packets are, for `subscribe`."""
    latest: str
    """Where its newest state is, for `Latest`; empty: nowhere."""
    cameras: tuple[dict[str, Any], ...]
    """For each: camera, width, height, sensor, tick_us, seed, latency_us, frames, imu, and
    subscribers by topic."""
    topics: tuple[dict[str, Any], ...]
    """For each: name, message, rate, queue, drop, per_camera."""


def discover(
    control: str, *, timeout_s: float = 5.0, server_key: str = "", key: str = ""
) -> Described:
    """Request the description of a publisher.

    Args:
        control: Its control port, tcp://HOST:PORT or ipc:///PATH.
        timeout_s: Time to wait for the answer, s.
        server_key: See `subscribe`.
        key: See `subscribe`.

    Returns:
        The description.

    Raises:
        EvsError: No answer in time, or the program is not a publisher.
    """
    answer = request(control, "describe", timeout_s=timeout_s, server_key=server_key, key=key)
    if integer(answer, "protocol", 0, 2**31) != PROTOCOL:
        raise EvsError(
            f"the publisher at {control} speaks version {answer['protocol']} of the protocol, not "
            f"{PROTOCOL}: it needs the evs that it came with"
        )
    return Described(
        address=_reachable(answer, "address", control),
        latest=_reachable(answer, "latest", control),
        cameras=_maps(answer, "cameras"),
        topics=_maps(answer, "topics"),
    )


def request(
    control: str,
    name: str,
    arguments: Mapping[str, object] | None = None,
    *,
    timeout_s: float = 5.0,
    server_key: str = "",
    key: str = "",
) -> dict[str, Any]:
    """Send one request to a control port.

    Args:
        control: The control port, tcp://HOST:PORT or ipc:///PATH.
        name: describe, status, camera_info, parameters, set or stop.
        arguments: Arguments of the request: `set` takes camera, a name, and values, key -> value.
        timeout_s: Time to wait for the answer, s.
        server_key: See `subscribe`.
        key: See `subscribe`.

    Returns:
        The answer.

    Raises:
        EvsError: No answer in time, a malformed one, or the error that the publisher returned.
    """
    if not timeout_s >= 0:
        raise EvsError(f"timeout_s is {timeout_s}: give seconds, 0 or more")
    if key and not server_key:
        raise EvsError("key needs server_key: give the publisher's public key")
    address = connectable(control)
    message = packb({**(arguments or {}), "request": name}, MAX_REQUEST_BYTES)
    with Context() as context, context.socket(zmq.REQ) as client:
        client.set(zmq.LINGER, 0)
        client.set(zmq.MAXMSGSIZE, MAX_ANSWER_BYTES)
        client.set(zmq.IPV6, int(is_ipv6(address)))
        if server_key:
            keys = read_secret(key) if key else new_keys()
            present(client, read_public(server_key, "server_key"), keys)
        client.connect(address)
        client.send(message)
        answer = _answer(client, address, timeout_s)
    if not boolean(answer, "ok"):
        raise EvsError(f"the publisher at {address} says: {shown(answer.get('error'))[1:-1]}")
    return answer


def _answer(client: Socket, address: str, timeout_s: float) -> dict[str, Any]:
    if not client.poll(min(2**31 - 1, math.ceil(1000 * timeout_s))):
        raise EvsError(
            f"nobody answers at {address} within {timeout_s:g} s: is it the control port of a "
            "publisher (control= in its [[sink]]), and does it know our key?"
        )
    parts = client.recv_multipart(zmq.NOBLOCK)
    if len(parts) != 1:
        raise MessageError(f"an answer of {len(parts)} parts from {address}, not one")
    return unpackb(parts[0], MAX_ANSWER_BYTES)


def _reachable(answer: dict[str, Any], field: str, control: str) -> str:
    """Return a bound address as seen from here; a wildcard host becomes the host of `control`."""
    bound = answer.get(field)
    if not isinstance(bound, str) or not (bound.startswith(("tcp://", "ipc://")) or bound == ""):
        raise MessageError(f"field {field!r} is {shown(bound)}, not an address")
    if is_ipc(bound):
        return bound
    host, _, port = bound.removeprefix("tcp://").rpartition(":")
    if host in _WILDCARDS:
        return f"{connectable(control).rpartition(':')[0]}:{port}"
    return bound


def _maps(answer: dict[str, Any], field: str) -> tuple[dict[str, Any], ...]:
    found = answer.get(field)
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise MessageError(f"field {field!r} is {shown(found)}, not a list of maps")
    return tuple(found)
