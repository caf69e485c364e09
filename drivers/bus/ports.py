"""The sockets of a publisher: one context, its authenticator, the control and the state port."""

from __future__ import annotations

import errno
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import zmq

from evs.drivers.bus.address import bindable, check_unused, is_ipc, is_ipv6, leave
from evs.drivers.bus.channels import Audience
from evs.drivers.bus.control import (
    MAX_RECEIVED_BYTES,
    PROTOCOL,
    Answer,
    Control,
)
from evs.drivers.bus.curve_keys import Keys, ZapAuthenticator, guard, read_allowed, read_secret
from evs.drivers.bus.latest import Watchers, conflated
from evs.drivers.bus.sockets import Context, Socket, serve_anybody
from evs.msgs import DEFAULT_ADDRESS, TOPICS, EvsError, MessageError, encode_state
from evs.msgs.header_fields import shown

if TYPE_CHECKING:
    from evs.drivers.run.sensor_control import SensorControl

_ANSWERS = 16
"""Answers held for a client that does not take them."""


@dataclass(frozen=True)
class ServerKeys:
    """A publisher's own keys and those of the allowed clients; none: it has no keys."""

    own: Keys | None = None
    allowed: frozenset[str] = frozenset()

    @classmethod
    def read(cls, key: str, allow: Sequence[str]) -> ServerKeys:
        """Read the keys from files. Raises EvsError for a bad key."""
        if allow and not key:
            raise EvsError("allow needs key: give the publisher's own secret key")
        return cls(read_secret(key) if key else None, read_allowed(allow))


class Ports:
    """All sockets of a publisher; what is sent on the first of them is the publisher's."""

    def __init__(self, keys: ServerKeys, control: str, latest: str, open_to_others: bool) -> None:
        """Check the addresses; nothing is bound yet.

        Args:
            keys: Of the publisher.
            control: Address of the control port; empty: none.
            latest: Address of the newest state; empty: any free port beside the control port.
            open_to_others: Whether other machines may connect.
        """
        self.control_address = bindable(control, open_to_others) if control else ""
        if control and not latest:
            control = self.control_address
            latest = f"{control}.latest" if is_ipc(control) else f"{control.rpartition(':')[0]}:0"
        self.latest_address = bindable(latest, open_to_others) if latest else ""
        self.stop_wanted = False
        self._keys = keys
        self._context: Context | None = None
        self._authenticator: ZapAuthenticator | None = None
        self._sockets: list[Socket] = []
        self._bound: list[str] = []
        self._poller = zmq.Poller()
        self._control: Control | None = None
        self._latest: Socket | None = None
        self._watchers: Watchers | None = None
        self._audience = Audience({})
        self._sensors: SensorControl | None = None
        self._address = ""
        self._counts = {"requests_answered": 0, "states_sent": 0}

    @property
    def watched(self) -> bool:
        """Whether a client reads the newest state."""
        return self._watchers is not None and self._watchers.count > 0

    @property
    def report(self) -> dict[str, Any]:
        """For the run report: addresses and counts, where there are such ports."""
        if not (self.control_address or self.latest_address):
            return {}
        return {"control": self.control_address, "latest": self.latest_address, **self._counts}

    def make(self, kind: int, address: str) -> Socket:
        """Return a new socket that is not bound, with authentication where there are keys."""
        if self._context is None:
            self._context = Context()
            if self._keys.own is not None:
                self._authenticator = ZapAuthenticator(self._context, self._keys.allowed)
                self._poller.register(self._authenticator.socket, zmq.POLLIN)
        made = conflated(self._context) if kind == zmq.PUB else self._context.socket(kind)
        self._sockets.append(made)
        made.set(zmq.IPV6, int(is_ipv6(address)))
        serve_anybody(made)
        if self._keys.own is not None:
            guard(made, self._keys.own)
        return made

    def bind(self, server: Socket, address: str) -> str:
        """Bind a socket, which `poll` waits for; return the address with the real port."""
        check_unused(address)
        try:
            server.bind(address)
        except zmq.ZMQError as reason:
            raise bind_error(address, reason) from None
        self._bound.append(address)
        if server.get(zmq.TYPE) != zmq.PUB:
            self._poller.register(server, zmq.POLLIN)
        return bytes(server.get(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode()

    def open(self, audience: Audience, address: str, sensors: SensorControl | None = None) -> None:
        """Open the configured ports.

        Args:
            audience: Cameras and subscribers of the publisher.
            address: Where the packets are published.
            sensors: What `set` changes; None: nothing.
        """
        self._sensors = sensors
        self._audience, self._address, self.stop_wanted = audience, address, False
        if self.latest_address:
            self._latest = self.make(zmq.PUB, self.latest_address)
            self._watchers = Watchers(self._latest)
            self.latest_address = self.bind(self._latest, self.latest_address)
        if self.control_address:
            server = self.make(zmq.ROUTER, self.control_address)
            server.set(zmq.MAXMSGSIZE, MAX_RECEIVED_BYTES)
            server.set(zmq.SNDHWM, _ANSWERS)
            self.control_address = self.bind(server, self.control_address)
            requests = {
                "describe": lambda _: self._describe(),
                "status": lambda _: self._status(),
                "camera_info": lambda _: self._camera_info(),
                "parameters": lambda _: {"cameras": self._changeable().parameters()},
                "set": self._set,
                "stop": lambda _: self._stop(),
            }
            self._control = Control(server, requests)

    def poll_requests(self) -> None:
        """Answer the requests that wait."""
        if self._authenticator is not None:
            self._authenticator.poll()
        if self._watchers is not None:
            self._watchers.update()
        if self._control is not None:
            self._control.poll()
            self._counts["requests_answered"] = self._control.answered

    def poll(self, wait_ms: int) -> None:
        """Wait for a request or a subscription, `wait_ms` at most."""
        self._poller.poll(wait_ms)

    def publish_state(self, *, end: bool = False) -> None:
        """Send the newest state to the clients that watch it."""
        if self._latest is not None and self.watched:
            self._latest.send(encode_state(self._audience.state(end=end)), zmq.NOBLOCK)
            self._counts["states_sent"] += 1

    def close(self) -> None:
        """Release every port. Safe to call twice."""
        if self._watchers is not None:
            self._watchers.close()
        for one in self._sockets:
            one.close(linger=0)
        if self._authenticator is not None:
            self._authenticator.close()
        if self._context is not None:
            self._context.term()
        for address in self._bound:
            leave(address)
        self._sockets, self._bound, self._poller = [], [], zmq.Poller()
        self._context = self._authenticator = self._watchers = self._control = self._latest = None

    def _describe(self) -> Answer:
        cameras = []
        for channel in self._audience.channels.values():
            stream = channel.stream
            plain = ("camera", "width", "height", "sensor", "tick_us", "seed", "latency_us")
            listeners = {topic.name: count for topic, count in channel.listeners.items()}
            described = {key: getattr(stream, key) for key in plain}
            cameras.append(
                {**described, "frames": stream.frames, "imu": stream.imu, "subscribers": listeners}
            )
        return {
            "protocol": PROTOCOL,
            "address": self._address,
            "latest": self.latest_address,
            "topics": [asdict(topic) for topic in TOPICS],
            "cameras": cameras,
        }

    def _status(self) -> Answer:
        statuses = []
        for status in self._audience.statuses(end=False):
            fields = asdict(status)
            del fields["cameras"]
            if fields["pace"] is None:
                del fields["pace"]
            time_end_us = fields.pop("time_end_us")
            statuses.append({**fields, "time_end": time_end_us})
        return {"cameras": statuses}

    def _camera_info(self) -> Answer:
        infos = (channel.info for channel in self._audience.channels.values())
        found = [asdict(info) for info in infos if info is not None]
        return {"cameras": [{k: _plain(v) for k, v in info.items()} for info in found]}

    def _changeable(self) -> SensorControl:
        if self._sensors is None:
            raise EvsError(
                "the sensors of this publisher cannot be changed: it has a process of its own "
                "(worker), or plays a recording"
            )
        return self._sensors

    def _set(self, fields: dict[str, Any]) -> Answer:
        camera, values = fields.get("camera", ""), fields.get("values")
        if not isinstance(camera, str):
            raise MessageError(f"field 'camera' is {shown(camera)}, not a name")
        if not isinstance(values, dict) or not values:
            raise MessageError(f"field 'values' is {shown(values)}, not a map of parameters")
        sensors = self._changeable()
        sensors.set(camera, values)
        return {"cameras": sensors.parameters()}

    def _stop(self) -> Answer:
        self.stop_wanted = True
        return {}


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def bind_error(address: str, reason: zmq.ZMQError) -> EvsError:
    """Return the error that says why an address could not be bound, and what to do."""
    if reason.errno == errno.EADDRINUSE:
        port = address.rpartition(":")[2]
        return EvsError(
            f"port {port} is in use: end the program that is bound to '{address}', "
            f"or give another port (0: any free one)"
        )
    if reason.errno == errno.EACCES:
        return EvsError(f"no right to bind '{address}': give a port of 1024 or more")
    return EvsError(f"cannot bind '{address}': {reason.strerror}; try {DEFAULT_ADDRESS}")
