"""Requests to a publisher's control port: who is here, where, and the end of the run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import zmq

from evs.drivers.bus.address import connectable, is_ipc, is_ipv6
from evs.drivers.bus.control import MAX_ANSWER_BYTES, PROTOCOL
from evs.drivers.bus.keys import new_keys, present, read_public, read_secret
from evs.drivers.bus.sockets import Context, Socket
from evs.msgs import EvsError, MessageError
from evs.msgs.header_fields import boolean, integer, shown
from evs.msgs.packet import packb, unpackb

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
    """Ask the control port at tcp://HOST:PORT what is there. Keys are those of `subscribe`.

    Raises EvsError where nobody answers within `timeout_s`, or what answers is no publisher.
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
    control: str, name: str, *, timeout_s: float = 5.0, server_key: str = "", key: str = ""
) -> dict[str, Any]:
    """One request to a control port (describe, status, camera_info, stop); its answer.

    Raises EvsError: no answer in time, one that is none, or the error that the publisher says.
    """
    if not timeout_s >= 0:
        raise EvsError(f"timeout_s is {timeout_s}: give seconds, 0 or more")
    if key and not server_key:
        raise EvsError("key needs server_key: give the publisher's public key")
    address = connectable(control)
    message = packb({"request": name})
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
    """An address as it is bound, from here: every address of its machine means the one we asked."""
    given = answer.get(field)
    if not isinstance(given, str) or not (given.startswith(("tcp://", "ipc://")) or given == ""):
        raise MessageError(f"field {field!r} is {shown(given)}, not an address")
    if is_ipc(given):
        return given
    host, _, port = given.removeprefix("tcp://").rpartition(":")
    if host in _WILDCARDS:
        return f"{connectable(control).rpartition(':')[0]}:{port}"
    return given


def _maps(answer: dict[str, Any], field: str) -> tuple[dict[str, Any], ...]:
    found = answer.get(field)
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise MessageError(f"field {field!r} is {shown(found)}, not a list of maps")
    return tuple(found)
