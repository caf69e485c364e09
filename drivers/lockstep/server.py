"""The server of a closed loop: physics moves once every controller has decided, never before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from evs.drivers.bus.address import bindable
from evs.drivers.bus.exchange import Peer, ServerEnd
from evs.drivers.bus.ports import ServerKeys
from evs.drivers.clock import Durations, monotonic_s
from evs.drivers.lockstep.barrier import Barrier, Decision, joint_controls
from evs.drivers.lockstep.clients import Client, Clients
from evs.msgs import EvsError, MessageError, Observation, StreamInfo
from evs.msgs.lockstep import (
    F64,
    LOCKSTEP_ADDRESS,
    LOCKSTEP_PROTOCOL,
    MAX_BLOB_BYTES,
    MAX_NAMES,
    Bye,
    Hello,
    Join,
    Parts,
    Request,
    Reset,
    Restore,
    Save,
    Step,
    decode_header,
    decode_request,
    encode_error,
    encode_observation,
    encode_reply,
    stream_fields,
)

TIMEOUT_S = 10.0
"""How long the others wait for a controller's decision."""

_MOST_FRAMES = 2
_MARGIN_BYTES = 1 << 20


class ServedLoop(Protocol):
    """What a server needs of a closed loop; ServedRun (serve.py) is one."""

    def reset(
        self, seed: int | None = None, keyframe: str = "", state: bool = False
    ) -> Observation:
        """Begin an episode."""

    def step(self, ctrl: npt.ArrayLike | None = None, ticks: int = 1) -> Observation:
        """Apply a control and advance by some ticks."""

    def save(self, compress: bool = False) -> bytes:
        """Return the whole state."""

    def restore(self, blob: bytes) -> Observation:
        """Return to a saved state."""

    @property
    def actuators(self) -> Sequence[str]:
        """Names of all actuators, in the order of the controls."""

    @property
    def ctrl(self) -> F64:
        """(nu,) the last controls that were decided, whether they act yet or not."""

    @property
    def ctrl_range(self) -> F64:
        """(nu, 2) lowest and highest control of each actuator; infinite where there is no limit."""

    @property
    def streams(self) -> Sequence[StreamInfo]:
        """What is constant of each camera."""

    @property
    def tick_us(self) -> int:
        """Length of a tick, us."""

    @property
    def t_us(self) -> int:
        """Simulated time, us."""

    @property
    def done(self) -> str:
        """The reason why the episode ended; "" if it continues or has not begun."""


class LockstepServer:
    """Serves a loop to one or more controllers. Use it in one thread: `open`, `serve`, `close`.

    A controller that does not decide within `timeout_s` of the first that did, or whose connection
    closes, loses its seat; the others are notified, and the loop waits for a reset or a restore.
    """

    def __init__(
        self,
        loop: ServedLoop,
        address: str = LOCKSTEP_ADDRESS,
        *,
        controllers: int = 1,
        timeout_s: float = TIMEOUT_S,
        key: str = "",
        allow: Sequence[str] = (),
        insecure: bool = False,
        warn: Callable[[str], None] | None = None,
    ) -> None:
        """Make a server that is not open yet.

        Args:
            loop: What controllers step.
            address: Where they connect: tcp://HOST:PORT or ipc:///PATH.
            controllers: How many have to have joined before anything moves.
            timeout_s: How long the others wait for one's decision, s.
            key: File of the secret key, as in the bus's Publisher; `allow` and `insecure` too.
            allow: Public keys that may control the loop.
            insecure: Whether other machines may without a key.
            warn: Gets a line for each controller that is lost.

        Raises:
            EvsError: A value or an address that cannot be.
        """
        if not 1 <= controllers <= MAX_NAMES:
            raise EvsError(f"controllers is {controllers}: give 1 ... {MAX_NAMES}")
        if not 0 < timeout_s <= 1e6:
            raise EvsError(f"timeout_s is {timeout_s}: give seconds, over 0")
        if max(len(loop.actuators), len(loop.streams)) > MAX_NAMES:
            raise EvsError(f"more than {MAX_NAMES} actuators or cameras are not served")
        self._wanted_address = bindable(address, bool(key) or insecure, does="serve a closed loop")
        self._keys = ServerKeys.read(key, allow)
        self._loop, self._timeout_s, self._warn = loop, timeout_s, warn
        self._clients = Clients(loop.actuators, loop.streams, controllers)
        self._barrier = Barrier(self._clients)
        self._end: ServerEnd | None = None
        self._fault = ""
        self._answered_s: float | None = None
        self._answers: dict[type[Any], Callable[[Client, Any], Parts]] = {
            Save: self._save,
            Bye: self._bye,
        }
        self.address = address
        """with the real port once open"""
        self.counts = {"episodes": 0, "steps": 0, "restores": 0, "saves": 0}
        self.counts |= {"controllers": 0, "controllers_lost": 0, "refused": 0, "repeated": 0}
        self.waits = Durations()
        """from an answer to the next complete decision, s"""

    def open(self) -> None:
        """Bind. Raises EvsError: port in use."""
        self._end = ServerEnd(self._wanted_address, self._keys, MAX_BLOB_BYTES + _MARGIN_BYTES)
        self.address = self._end.address

    def serve(self, stopped: Sequence[str]) -> None:
        """Answer until `stopped` holds something."""
        while not stopped:
            self.poll()

    def poll(self) -> bool:
        """Wait briefly for a request and handle it; return whether one came."""
        if self._end is None:
            raise EvsError("this server is not open: call open() first")
        came = self._end.receive()
        if came is not None:
            self._take(*came)
        for identity in self._end.gone():
            self._lose([identity], "has gone (its connection closed)")
        since_s = self._barrier.since_s
        if since_s is not None and monotonic_s() - since_s > self._timeout_s:
            self._give_up()
        return came is not None

    def close(self) -> None:
        """Release the port; clients that wait get an error. Safe to call twice."""
        if self._end is None:
            return
        for client in self._clients.present.values():
            if client.answer is None:
                self._answer(
                    client, encode_error(client.number, "the server of the loop has ended")
                )
        self._end.close()
        self._end = None

    def report(self) -> dict[str, Any]:
        """Return counts for the run report, and how long decisions took, ms."""
        times = {
            "median": round(1e3 * self.waits.quantile_s(0.5), 6),
            "p99": round(1e3 * self.waits.quantile_s(0.99), 6),
        }
        return {"address": self.address, **self.counts, "decision_ms": times}

    def _take(self, peer: Peer, parts: list[Any]) -> None:
        """Handle one request; answer now, or when the other controllers have decided."""
        if not parts:
            return
        number, client = 0, self._clients.present.get(peer[0])
        try:
            number, fields = decode_header(parts[0])
            if client is not None and number <= client.number:
                self._repeat(client, number, peer)
                return
            if client is not None:
                # one request at a time: the client has given up one that has no answer yet
                self._withdraw(peer[0])
                client.number, client.answer, client.peer = number, None, peer
            if len(parts) > _MOST_FRAMES:
                raise MessageError("a request has one or two frames, this has more")
            request = decode_request(fields, parts[1] if len(parts) > 1 else None)
            self._do(peer, client, number, request)
        except EvsError as reason:
            self.counts["refused"] += 1
            answer = encode_error(number, str(reason))
            if client is None or not number:
                self._send(peer, answer)
            else:
                self._answer(client, answer)

    def _do(self, peer: Peer, client: Client | None, number: int, request: Request) -> None:
        if isinstance(request, Hello):
            described = encode_reply(number, description(self._loop, self._clients))
            if client is None:
                self._send(peer, described)
            else:
                self._answer(client, described)
        elif isinstance(request, Join):
            self._join(peer, number, request)
        elif client is None:
            raise EvsError("you have no seat here, or lost it: join first (evs.connect does)")
        elif isinstance(request, Reset | Step | Restore):
            self._decide(peer[0], request)
        else:
            self._answer(client, self._answers[type(request)](client, request))

    def _join(self, peer: Peer, number: int, join: Join) -> None:
        before = len(self._clients.present)
        client = self._clients.admit(peer, join)
        client.number, client.peer = number, peer
        self.counts["controllers"] += len(self._clients.present) - before
        described = description(self._loop, self._clients)
        mine = [self._clients.actuators[place] for place in client.actuators]
        described |= {"actuators": mine, "timeout_s": self._timeout_s}
        described["cameras"] = [
            one for one in described["cameras"] if one["camera"] in client.cameras
        ]
        described["cameras"].sort(key=lambda one: client.cameras[one["camera"]])
        limits = np.asarray(self._loop.ctrl_range, "<f8").reshape(-1, 2)[client.actuators]
        self._answer(client, encode_reply(number, described, limits.tobytes()))

    def _save(self, client: Client, save: Save) -> Parts:
        blob = self._loop.save(save.compress)
        if len(blob) > MAX_BLOB_BYTES:
            raise EvsError(f"the saved loop has {len(blob)} bytes: over 1 GiB does not travel")
        self.counts["saves"] += 1
        return encode_reply(client.number, {}, blob)

    def _bye(self, client: Client, _: Bye) -> Parts:
        identity = client.peer[0]
        del self._clients.present[identity]
        if self._barrier.decisions:
            self._break(f"controller '{client.name}' has left")
        if self._end is not None:
            self._end.forget(identity)
        return encode_reply(client.number, {})

    def _decide(self, identity: bytes, decision: Decision) -> None:
        if self._fault and isinstance(decision, Step):
            raise EvsError(f"{self._fault}; nothing has moved since: reset, or restore")
        self._barrier.add(identity, decision, monotonic_s())
        if not self._barrier.complete:
            return
        decisions = self._barrier.clear()
        if self._answered_s is not None and isinstance(decision, Step):
            self.waits.add(monotonic_s() - self._answered_s)
        try:
            self._move(decisions, decision)
        except EvsError as reason:
            # the loop refused it, and has not moved: every controller gets the error
            for one in decisions:
                other = self._clients.present[one]
                self._answer(other, encode_error(other.number, str(reason)))
        except BaseException as reason:
            line = f"the loop has failed: {reason or type(reason).__name__}"
            for one in decisions:
                other = self._clients.present[one]
                self._answer(other, encode_error(other.number, line))
            raise
        self._answered_s = monotonic_s()

    def _move(self, decisions: dict[bytes, Decision], decision: Decision) -> None:
        clients = self._clients.present
        if isinstance(decision, Step):
            ctrl = joint_controls(decisions, clients, lambda: self._loop.ctrl)
            seen = self._loop.step(ctrl, decision.ticks)
            self.counts["steps"] += 1
        elif isinstance(decision, Reset):
            wants = {one: isinstance(it, Reset) and it.state for one, it in decisions.items()}
            seen = self._loop.reset(decision.seed, decision.keyframe, any(wants.values()))
            for one, wanted in wants.items():
                clients[one].wants_state = wanted
            self._fault = ""
            self.counts["episodes"] += 1
        else:
            seen = self._loop.restore(decision.blob)
            self._fault = ""
            self.counts["restores"] += 1
            if len(clients) == 1:
                # with several, each keeps the choice of its reset
                next(iter(clients.values())).wants_state = seen.state is not None
        for one in decisions:
            self._answer(clients[one], answer_of(clients[one], seen))

    def _withdraw(self, identity: bytes) -> None:
        """Drop a controller's earlier request that has no answer yet."""
        self._barrier.withdraw(identity)

    def _repeat(self, client: Client, number: int, peer: Peer) -> None:
        """Send the answer to a repeated request again, if there is one; do nothing else."""
        self.counts["repeated"] += 1
        if number == client.number and client.answer is not None:
            self._send(peer, client.answer)

    def _give_up(self) -> None:
        """Break the barrier: a controller has not decided in time."""
        if self._clients.full:
            self._lose(self._barrier.missing, f"gave no decision for {self._timeout_s:g} s")
            return
        # those who are here may wait for the others, too
        here, wanted = len(self._clients.present), self._clients.controllers
        self._break(
            f"{here} of {wanted} controllers are here ({self._clients.names}) after "
            f"{self._timeout_s:g} s: start the others"
        )

    def _lose(self, identities: Sequence[bytes], why: str) -> None:
        """Remove controllers; identities that never joined are ignored."""
        lost = [client for one in identities if (client := self._clients.present.pop(one, None))]
        for identity in identities:
            self._barrier.withdraw(identity)
        if not lost:
            return
        self.counts["controllers_lost"] += len(lost)
        names = ", ".join(f"'{client.name}'" for client in lost)
        line = f"controller{'s' if len(lost) > 1 else ''} {names} {why}"
        if self._warn is not None:
            self._warn(line)
        self._break(line)

    def _break(self, line: str) -> None:
        """Report to all that wait why nothing has moved; refuse steps until a reset."""
        self._fault = line
        for identity in self._barrier.clear():
            other = self._clients.present[identity]
            self._answer(other, encode_error(other.number, f"{line}; {self._next_moves}"))

    @property
    def _next_moves(self) -> str:
        """What the controllers that waited can do."""
        return "nothing has moved: reset, or restore"

    def _answer(self, client: Client, parts: Parts) -> None:
        client.answer = parts
        self._send(client.peer, parts)

    def _send(self, peer: Peer, parts: Parts) -> None:
        if self._end is not None:
            self._end.answer(peer, parts)


def answer_of(client: Client, seen: Observation) -> Parts:
    """Encode the answer to one controller: its own encoders, the cameras it sees."""
    size = sum(packet.events.nbytes for packet in seen.packets)
    if size > MAX_BLOB_BYTES:
        line = (
            f"{size} bytes of events came in these ticks: over 1 GiB does not travel, ask for fewer"
        )
        return encode_error(client.number, line)
    encoders = np.array([seen.position, seen.velocity])
    if not client.has_all:
        encoders = encoders[:, client.actuators]
    state = seen.state if client.wants_state else None
    return encode_observation(client.number, seen, encoders, client.cameras, state)


def description(loop: ServedLoop, clients: Clients) -> dict[str, Any]:
    """Describe the cameras, the actuators and the clients, as plain values of a header."""
    return {
        "protocol": LOCKSTEP_PROTOCOL,
        "tick_us": loop.tick_us,
        "actuators": list(clients.actuators),
        "cameras": [stream_fields(stream) for stream in loop.streams],
        "controllers": clients.controllers,
        "joined": [client.name for client in clients.present.values()],
    }
