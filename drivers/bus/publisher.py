"""The publishing end of the bus: a sink that never slows the camera down."""

from __future__ import annotations

import errno
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import zmq

from evs.drivers.bus.address import bindable, is_ipv6
from evs.drivers.bus.gate import Gate
from evs.drivers.bus.keys import guard, read_allowed, read_secret
from evs.drivers.bus.sockets import Context, Socket, readable
from evs.drivers.pace import monotonic_s
from evs.emulator.stages import Meter, NoMeter
from evs.msgs import (
    DEFAULT_ADDRESS,
    EVENTS,
    FRAMES,
    IMU,
    STATUS,
    TOPICS,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    Status,
    StreamInfo,
    Topic,
    encode,
    encode_frame,
    encode_imu,
    encode_status,
    unknown,
)
from evs.msgs.fields import check_name
from evs.msgs.packet import MAX_FRAME_BYTES
from evs.msgs.status import MAX_CAMERAS, STATUS_PERIOD_US

LINGER_S = 2.0
"""How long a closing publisher waits for its subscribers to learn that it ends."""

_REPEAT_MS = 20
_REQUEST_BYTES = 4096
"""Longest subscription taken from a client."""
_MOST_REQUESTS = 1000
"""Subscriptions taken in before a packet leaves: who sends them without end stops no camera."""


@dataclass
class _Channel:
    """One camera's topics and its totals."""

    stream: StreamInfo
    topics: dict[Topic, bytes]
    listeners: dict[Topic, int] = field(default_factory=lambda: dict.fromkeys(TOPICS, 0))
    seq: int = -1
    packets: int = 0
    events: int = 0
    time_end_us: int = 0


class Publisher:
    """Publishes the packets of one or more cameras on tcp://HOST:PORT. One thread uses it.

    With `key`, the NAME.secret.key of a pair that `evs keygen` made, all that is sent is encrypted
    and only those listen who know its public key; with `allow` (public keys: files, folders of
    files, or written out) only their owners. Without, `insecure` has to say that others may listen.

    Nothing is encoded or sent while nobody subscribes. A subscriber that is too slow loses the
    newest packets once `queue` of them wait for it, and can count them; nobody else notices. `open`
    waits up to `wait_s` until `wait_for` subscribers of events are there. `close` repeats the last
    status while subscribers are connected, `linger_s` at most.
    """

    def __init__(
        self,
        address: str = DEFAULT_ADDRESS,
        *,
        wait_for: int = 0,
        wait_s: float = 10.0,
        queue: int = EVENTS.queue,
        linger_s: float = LINGER_S,
        key: str = "",
        allow: Sequence[str] = (),
        insecure: bool = False,
    ) -> None:
        if wait_for < 0:
            raise EvsError(f"wait_for is {wait_for}: give the number of subscribers, 0 or more")
        if not wait_s >= 0:
            raise EvsError(f"wait_s is {wait_s}: give the seconds to wait, 0 or more")
        if not linger_s >= 0:
            raise EvsError(f"linger_s is {linger_s}: give the seconds to wait, 0 or more")
        if queue < 1:
            raise EvsError(f"queue is {queue}: give the packets that may wait, 1 or more")
        self.meter: Meter = NoMeter()
        if allow and not key:
            raise EvsError("allow is of no use without key: give the publisher's own secret key")
        self._keys = read_secret(key) if key else None
        self._allowed = read_allowed(allow)
        self._wanted_address = bindable(address, bool(key) or insecure)
        self._gate: Gate | None = None
        self._wait_for, self._wait_s, self._linger_s = wait_for, wait_s, linger_s
        self._queue = queue
        self._context: Context | None = None
        self._socket: Socket | None = None
        self._poller = zmq.Poller()
        self._channels: dict[str, _Channel] = {}
        self._address = address
        self._subscribers = 0
        self._has_beside = False
        self._sent = {"packets_sent": 0, "events_sent": 0, "bytes_sent": 0, "statuses_sent": 0}
        self._unsent = {"packets_unsubscribed": 0, "packets_oversized": 0}
        self._beside = {"frames_sent": 0, "imu_samples_sent": 0}

    @property
    def address(self) -> str:
        """The address that is bound, with the real port once open."""
        return self._address

    @property
    def subscribers(self) -> int:
        """Subscribers of events at the last look."""
        return self._subscribers

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Bind and wait for subscribers. Raises EvsError: port in use, nobody came, bad names."""
        if self._socket is not None:
            raise EvsError("this publisher is open already: close it first, or make another")
        self._channels = _channels(streams)
        self._has_beside = any(stream.frames or stream.imu for stream in streams)
        self._context = Context()
        self._socket = self._context.socket(zmq.XPUB)
        try:
            if self._keys is not None:
                self._gate = Gate(self._context, self._allowed)
                guard(self._socket, self._keys)
            # every subscription and its end is told, so that subscribers can be counted
            self._socket.set(zmq.XPUB_VERBOSER, 1)
            self._socket.set(zmq.SNDHWM, self._queue)
            self._socket.set(zmq.MAXMSGSIZE, _REQUEST_BYTES)
            self._socket.set(zmq.IPV6, int(is_ipv6(self._wanted_address)))
            self._bind(self._socket)
            for heard in (self._socket, *([] if self._gate is None else [self._gate.socket])):
                self._poller.register(heard, zmq.POLLIN)
            self._await_subscribers(self._socket)
        except BaseException:
            self._release()
            raise

    def write(self, packet: EventPacket) -> None:
        """Send one packet to whoever subscribes, without waiting.

        Raises EvsError for a camera that was not opened and for a packet that breaks its promises.
        """
        server, channel = self._channel(packet.camera)
        period_before = channel.time_end_us // STATUS_PERIOD_US
        channel.seq, channel.time_end_us = packet.seq, packet.time_end_us
        channel.packets += 1
        channel.events += len(packet.events)
        if channel.listeners[EVENTS] == 0:
            self._unsent["packets_unsubscribed"] += 1
        elif packet.events.nbytes > MAX_FRAME_BYTES:
            # every subscriber would cut the connection; now each counts one lost packet
            self._unsent["packets_oversized"] += 1
        else:
            self._send(server, channel, EVENTS, *encode(packet))
            self._sent["packets_sent"] += 1
            self._sent["events_sent"] += len(packet.events)
        if packet.time_end_us // STATUS_PERIOD_US > period_before:
            self._send_status(server, channel, end=False)

    def write_frame(self, frame: Frame) -> None:
        """Send one intensity frame to whoever subscribes to frames. Raises EvsError as write.

        One that is too large for the bus is left out; each subscriber counts it as lost.
        """
        server, channel = self._channel(frame.camera)
        if channel.listeners[FRAMES] and frame.pixels.nbytes <= MAX_FRAME_BYTES:
            self._send(server, channel, FRAMES, *encode_frame(frame))
            self._beside["frames_sent"] += 1

    def write_imu(self, packet: ImuPacket) -> None:
        """Send one tick's IMU samples to whoever subscribes to them. Raises EvsError as write."""
        server, channel = self._channel(packet.camera)
        if channel.listeners[IMU] and packet.samples.nbytes <= MAX_FRAME_BYTES:
            self._send(server, channel, IMU, *encode_imu(packet))
            self._beside["imu_samples_sent"] += len(packet)

    def _channel(self, camera: str) -> tuple[Socket, _Channel]:
        """The socket, with everything heard, and the channel of a camera."""
        if self._socket is None:
            raise EvsError("this publisher is not open: call open(streams) first")
        channel = self._channels.get(camera)
        if channel is None:
            raise unknown("camera on the bus", camera, self._channels)
        self._hear(self._socket)
        return self._socket, channel

    def close(self) -> dict[str, Any]:
        """Tell the subscribers the totals, then release the port. Safe to call twice."""
        if self._socket is not None:
            try:
                self._say_goodbye(self._socket)
            finally:
                self._release()
        return {
            "type": "zmq",
            "address": self._address,
            **self._sent,
            **self._unsent,
            **(self._beside if self._has_beside else {}),
        }

    def _bind(self, server: Socket) -> None:
        try:
            server.bind(self._wanted_address)
        except zmq.ZMQError as reason:
            raise _bind_error(self._wanted_address, reason) from None
        endpoint = server.get(zmq.LAST_ENDPOINT)
        self._address = bytes(endpoint).rstrip(b"\0").decode()

    def _await_subscribers(self, server: Socket) -> None:
        deadline_s = monotonic_s() + self._wait_s
        self._hear(server)
        while self._subscribers < self._wait_for:
            remaining_s = deadline_s - monotonic_s()
            if remaining_s <= 0:
                raise EvsError(
                    f"{self._subscribers} of {self._wait_for} subscribers came to {self._address} "
                    f"within {self._wait_s:g} s: start them first, e.g. evs echo {self._address}"
                )
            self._poller.poll(min(1000, max(1, int(remaining_s * 1000))))
            self._hear(server)

    def _hear(self, server: Socket) -> None:
        """Take in who came and who went. A request is one byte, 1 or 0, and a prefix of topics."""
        if self._gate is not None:
            self._gate.look()
        for _ in range(_MOST_REQUESTS):
            if not readable(server):
                break
            request = b"".join(server.recv_multipart(zmq.NOBLOCK))
            if request[:1] not in (b"\x00", b"\x01"):
                continue
            change = 1 if request[0] else -1
            prefix, wants_events = request[1:], False
            for channel in self._channels.values():
                for topic, name in channel.topics.items():
                    if name.startswith(prefix):
                        channel.listeners[topic] = max(0, channel.listeners[topic] + change)
                        wants_events |= topic == EVENTS
            if wants_events:
                self._subscribers = max(0, self._subscribers + change)

    def _send(
        self, server: Socket, channel: _Channel, topic: Topic, header: bytes, frame: memoryview
    ) -> None:
        self.meter.lap("pack")
        # a full queue drops it for that subscriber only; copied, since the sender goes on
        server.send_multipart([channel.topics[topic], header, frame], zmq.NOBLOCK)
        self._sent["bytes_sent"] += len(channel.topics[topic]) + len(header) + frame.nbytes

    def _send_status(self, server: Socket, channel: _Channel, *, end: bool) -> None:
        if channel.listeners[STATUS] == 0:
            return
        header = encode_status(_status(channel, tuple(self._channels), end=end))
        server.send_multipart([channel.topics[STATUS], header], zmq.NOBLOCK)
        self._sent["statuses_sent"] += 1
        self._sent["bytes_sent"] += len(channel.topics[STATUS]) + len(header)

    def _say_goodbye(self, server: Socket) -> None:
        """Repeat every camera's end status until nobody listens or the time is up.

        A status is dropped by a full queue like any packet, so saying it once is not enough.
        """
        deadline_s = monotonic_s() + self._linger_s
        self._hear(server)
        while any(any(one.listeners.values()) for one in self._channels.values()):
            for channel in self._channels.values():
                self._send_status(server, channel, end=True)
            if monotonic_s() >= deadline_s:
                break
            self._poller.poll(_REPEAT_MS)
            self._hear(server)

    def _release(self) -> None:
        # what is still queued belongs to subscribers that did not read for the whole linger time
        if self._socket is not None:
            self._socket.close(linger=0)
        if self._gate is not None:
            self._gate.close()
        if self._context is not None:
            self._context.term()
        self._socket = self._context = self._gate = None
        self._poller = zmq.Poller()


def _channels(streams: Sequence[StreamInfo]) -> dict[str, _Channel]:
    if not 1 <= len(streams) <= MAX_CAMERAS:
        raise EvsError(f"{len(streams)} cameras on one bus: give 1 ... {MAX_CAMERAS}")
    channels: dict[str, _Channel] = {}
    for stream in streams:
        check_name(stream.camera, "camera name")
        if stream.camera in channels:
            raise EvsError(f"two cameras are named '{stream.camera}': give each its own name")
        topics = {topic: topic.of(stream.camera) for topic in TOPICS}
        channels[stream.camera] = _Channel(stream, topics)
    for channel in channels.values():
        # values that do not fit into a status are an error now, not in the middle of the run
        encode_status(_status(channel, tuple(channels), end=False))
    return channels


def _status(channel: _Channel, cameras: tuple[str, ...], *, end: bool) -> Status:
    stream = channel.stream
    return Status(
        camera=stream.camera,
        seq=channel.seq,
        packets=channel.packets,
        events=channel.events,
        time_end_us=channel.time_end_us,
        end=end,
        width=stream.width,
        height=stream.height,
        sensor=stream.sensor,
        tick_us=stream.tick_us,
        seed=stream.seed,
        cameras=cameras,
    )


def _bind_error(address: str, reason: zmq.ZMQError) -> EvsError:
    if reason.errno == errno.EADDRINUSE:
        port = address.rpartition(":")[2]
        return EvsError(
            f"port {port} is in use: end the program that publishes on '{address}', "
            f"or give another port (0: any free one)"
        )
    if reason.errno == errno.EACCES:
        return EvsError(f"no right to bind '{address}': give a port of 1024 or more")
    return EvsError(f"cannot bind '{address}': {reason.strerror}; try {DEFAULT_ADDRESS}")
