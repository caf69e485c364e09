"""The publishing end of the bus: a sink that never slows the camera down."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import zmq

from evs.drivers.bus.address import bindable, is_ipv6
from evs.drivers.bus.channels import Audience, Channel, make_channels
from evs.drivers.bus.ports import Ports, ServerKeys
from evs.drivers.bus.sockets import Socket, quick_check, readable, receive_parts, send_parts
from evs.drivers.clock import monotonic_s
from evs.drivers.sink import Sink, Stream
from evs.drivers.sink_config import ZmqSink
from evs.emulator.base.scene import F32, GroundTruth
from evs.msgs import (
    CAMERA_INFO,
    CLOCK,
    DEFAULT_ADDRESS,
    EVENTS,
    FRAMES,
    IMU,
    LIGHT,
    POSE,
    STATUS,
    TRUTH,
    TRUTH_CHANNELS,
    Clock,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    Pace,
    Pose,
    StreamInfo,
    Topic,
    Truth,
    encode,
    encode_camera_info,
    encode_clock,
    encode_frame,
    encode_imu,
    encode_pose,
    encode_status,
    encode_truth,
    unknown,
)
from evs.msgs.packet import MAX_FRAME_BYTES
from evs.msgs.status import STATUS_PERIOD_US

LEAST_BYTES = 512 * 1024
"""ZeroMQ copies shorter frames itself, which is faster than lending it memory."""

MOST_BYTES = 64 * 1024 * 1024
"""Most memory; ZeroMQ itself copies what waits for slow subscribers beyond it."""


class Buffers:
    """Copies frames into memory that is used again once no subscriber waits for the frame."""

    def __init__(self) -> None:
        self.bytes = 0
        """memory in use"""
        self._lent: list[tuple[memoryview, zmq.MessageTracker]] = []

    def copied(self, raw: memoryview) -> memoryview | zmq.Frame:
        """Return what to send so that `raw`, of format B, may change afterwards."""
        if raw.nbytes < LEAST_BYTES:
            return raw
        memory = self._free(raw.nbytes)
        if memory is None:
            return raw
        memory[: raw.nbytes] = raw
        frame = zmq.Frame(memory[: raw.nbytes], copy=False, track=True)
        assert frame.tracker is not None
        # the tracker, not the frame: a reference to the frame would keep its memory in use
        self._lent.append((memory, frame.tracker))
        return frame

    def _free(self, size: int) -> memoryview | None:
        """Return free memory of at least `size` bytes; None if MOST_BYTES are in use."""
        for place, (memory, tracker) in enumerate(self._lent):
            if tracker.done:
                del self._lent[place]
                if memory.nbytes >= size:
                    return memory
                # a larger one takes its place
                self.bytes -= memory.nbytes
                break
        if self.bytes + size > MOST_BYTES:
            return None
        # room for the next ones, which are seldom of quite this size
        room = min(size + size // 4, MOST_BYTES - self.bytes)
        self.bytes += room
        return np.empty(room, np.uint8).data


LINGER_S = 2.0
"""How long a closing publisher waits for its subscribers to learn that it ends."""

LIGHT_PERIOD_S = 0.04
"""Shortest time between two pictures of the light, of the wall clock: they are for people."""

_REPEAT_MS = 20
_REQUEST_BYTES = 4096
"""Longest subscription taken from a client."""
_MOST_REQUESTS = 1000
"""Subscriptions read before a packet leaves: an endless stream of them does not stop the camera."""


class Publisher(Sink):
    """Publishes the packets of cameras on tcp://HOST:PORT or ipc:///PATH. One thread uses it.

    Topics without subscribers cost nothing. A slow subscriber loses the newest packets once `queue`
    of them wait for it, and can count them. Other subscribers are not affected.
    """

    streams = frozenset(
        {
            *(Stream.EVENTS, Stream.FRAMES, Stream.IMU),
            *(Stream.POSE, Stream.GROUND_TRUTH, Stream.LIGHT, Stream.PACE),
        }
    )

    def __init__(
        self,
        address: str = DEFAULT_ADDRESS,
        *,
        wait_for: int = ZmqSink.wait_for,
        wait_s: float = ZmqSink.wait_s,
        queue: int = ZmqSink.queue,
        linger_s: float = LINGER_S,
        control: str = "",
        latest: str = "",
        truth_hz: float = ZmqSink.truth_hz,
        key: str = "",
        allow: Sequence[str] = (),
        insecure: bool = False,
    ) -> None:
        """Make a publisher, which `open` opens.

        Args:
            address: Address of the packets.
            wait_for: Subscribers of events that `open` waits for.
            wait_s: Time to wait, s.
            queue: Packets that may wait for each subscriber.
            linger_s: Maximum time for which `close` repeats the last status while subscribers are
                connected, s.
            control: Address of the control port, which describes the streams and takes requests.
            latest: Address of the newest state; any free port if only `control` is given.
            truth_hz: Ground-truth messages per simulated second.
            key: The file NAME.secret.key of a pair that `evs keygen` made. Traffic is then
                encrypted, and only clients with the public key can subscribe.
            allow: Public keys (files, folders of files, or the keys themselves) of the only clients
                that may subscribe.
            insecure: Whether other machines may subscribe without a key.

        Raises:
            EvsError: An invalid value or address, or a key that cannot be read.
        """
        if wait_for < 0:
            raise EvsError(f"wait_for is {wait_for}: give the number of subscribers, 0 or more")
        if not wait_s >= 0:
            raise EvsError(f"wait_s is {wait_s}: give the seconds to wait, 0 or more")
        if not linger_s >= 0:
            raise EvsError(f"linger_s is {linger_s}: give the seconds to wait, 0 or more")
        if queue < 1:
            raise EvsError(f"queue is {queue}: give the packets that may wait, 1 or more")
        if not 0 < truth_hz <= 1e6:
            raise EvsError(f"truth_hz is {truth_hz}: give the rate of ground truth, over 0")
        keys = ServerKeys.read(key, allow)
        self._wanted_address = bindable(address, bool(key) or insecure)
        self._ports = Ports(keys, control, latest, bool(key) or insecure)
        self._wait_for, self._wait_s, self._linger_s = wait_for, wait_s, linger_s
        self._queue, self._truth_us = queue, max(1, round(1e6 / truth_hz))
        self._socket: Socket | None = None
        self._audience = Audience({})
        self._buffers = Buffers()
        self._quick = quick_check()
        self._address = address
        self._clock_us: int | None = None
        self._has_auxiliary = self._requests_read = False
        self._sent = {"packets_sent": 0, "events_sent": 0, "bytes_sent": 0, "statuses_sent": 0}
        self._unsent = {"packets_unsubscribed": 0, "packets_oversized": 0}
        self._auxiliary_sent = {"frames_sent": 0, "imu_samples_sent": 0}

    @property
    def address(self) -> str:
        """The address that is bound, with the real port once open."""
        return self._address

    @property
    def control_address(self) -> str:
        """Address of the control port, with the real port once open; empty: none."""
        return self._ports.control_address

    @property
    def latest_address(self) -> str:
        """Address of the newest state, with the real port once open; empty: none."""
        return self._ports.latest_address

    @property
    def subscribers(self) -> int:
        """Number of subscribers of events, at the last read of requests."""
        return self._audience.subscribers

    @property
    def stop_wanted(self) -> bool:
        """Whether a client of the control port requested the end."""
        return self._ports.stop_wanted

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Bind and wait for subscribers. Raises EvsError: port in use, no subscriber, bad names."""
        if self._socket is not None:
            raise EvsError("this publisher is open already: close it first, or make another")
        self._audience = Audience(make_channels(streams))
        self._has_auxiliary = any(stream.frames or stream.imu for stream in streams)
        try:
            self._socket = server = self._ports.make(zmq.XPUB, self._wanted_address)
            # reports every subscription and its end, so that subscribers can be counted
            server.set(zmq.XPUB_VERBOSER, 1)
            server.set(zmq.SNDHWM, self._queue)
            server.set(zmq.MAXMSGSIZE, _REQUEST_BYTES)
            server.set(zmq.IPV6, int(is_ipv6(self._wanted_address)))
            self._address = self._ports.bind(server, self._wanted_address)
            self._ports.open(self._audience, self._address, self.sensors)
            self._await_subscribers(server)
        except BaseException:
            self._release()
            raise

    def write(self, packet: EventPacket) -> None:
        """Send one packet to the subscribers, without waiting.

        Raises EvsError for a camera that was not opened and for an invalid packet.
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
            self._send(server, channel, EVENTS, *encode(packet, self._quick))
            self._sent["packets_sent"] += 1
            self._sent["events_sent"] += len(packet.events)
        if self._audience.clock:
            self._send_clock(server, packet.time_end_us)
        if packet.time_end_us // STATUS_PERIOD_US > period_before:
            self._send_status(server, channel, end=False)
            if channel.info is not None and channel.listeners[CAMERA_INFO]:
                self._send(server, channel, CAMERA_INFO, encode_camera_info(channel.info))
        self._ports.publish_state()

    def write_frame(self, frame: Frame) -> None:
        """Send one intensity frame to the subscribers of frames. Raises EvsError like `write`.

        A frame that is too large for the bus is omitted; each subscriber counts it as lost.
        """
        server, channel = self._channel(frame.camera)
        channel.last[FRAMES.name] = frame.seq
        if channel.listeners[FRAMES] and frame.pixels.nbytes <= MAX_FRAME_BYTES:
            self._send(server, channel, FRAMES, *encode_frame(frame))
            self._auxiliary_sent["frames_sent"] += 1

    def write_imu(self, packet: ImuPacket) -> None:
        """Send one tick's IMU samples to their subscribers. Raises EvsError like `write`."""
        server, channel = self._channel(packet.camera)
        channel.last[IMU.name], channel.imu = packet.seq, packet
        if channel.listeners[IMU] and packet.samples.nbytes <= MAX_FRAME_BYTES:
            self._send(server, channel, IMU, *encode_imu(packet))
            self._auxiliary_sent["imu_samples_sent"] += len(packet)

    def wants_pose(self, camera: str) -> bool:
        """Return whether a client subscribes to poses, or reads the newest state."""
        self._requests_read = False
        _, channel = self._channel(camera)
        # called before each packet, which need not read again: that costs more than the rest
        self._requests_read = True
        return channel.listeners[POSE] > 0 or self._ports.watched

    def write_pose(self, pose: Pose) -> None:
        """Send one pose to the subscribers of poses. Raises EvsError like `write`."""
        server, channel = self._channel(pose.camera)
        channel.last[POSE.name], channel.pose = pose.seq, pose
        if channel.listeners[POSE]:
            self._send(server, channel, POSE, encode_pose(pose))

    def write_pace(self, pace: Pace) -> None:
        """Include the pace of the run in the status messages from now on."""
        for channel in self._audience.channels.values():
            channel.pace = pace

    def wants_truth(self, camera: str, t_us: int) -> bool:
        """Return whether a client subscribes to ground truth and a message is due."""
        channel = self._audience.channels[camera]
        begin_us = t_us - channel.stream.tick_us
        return channel.listeners[TRUTH] > 0 and t_us // self._truth_us > begin_us // self._truth_us

    def write_truth(self, camera: str, truth: GroundTruth) -> None:
        """Send ground truth to its subscribers. Raises EvsError like `write`."""
        server, channel = self._channel(camera)
        seq = channel.last.get(TRUTH.name, -1) + 1
        channel.last[TRUTH.name] = seq
        channels = {key: getattr(truth, key) for key in TRUTH_CHANNELS}
        header, raw = encode_truth(Truth(seq, truth.t_us, channels, camera))
        if raw.nbytes <= MAX_FRAME_BYTES:
            self._send(server, channel, TRUTH, header, raw)

    def wants_light(self, camera: str, t_us: int) -> bool:  # noqa: ARG002
        """Return whether a client subscribes to the light, and a picture of it is due."""
        channel = self._audience.channels[camera]
        return channel.listeners[LIGHT] > 0 and monotonic_s() >= channel.light_due_s

    def write_light(self, camera: str, t_us: int, luminance: F32) -> None:
        """Send the light as a picture to its subscribers. Raises EvsError like `write`.

        All pictures of a camera have the exposure of the brightest picture so far.
        """
        server, channel = self._channel(camera)
        channel.light_due_s = monotonic_s() + LIGHT_PERIOD_S
        seq = channel.light_seq = channel.light_seq + 1
        picture = Frame(seq, t_us, t_us, t_us, t_us, channel.exposure.code(luminance), camera)
        if picture.pixels.nbytes <= MAX_FRAME_BYTES:
            self._send(server, channel, LIGHT, *encode_frame(picture))

    def _channel(self, camera: str) -> tuple[Socket, Channel]:
        """The socket, with all requests read, and the channel of a camera."""
        if self._socket is None:
            raise EvsError("this publisher is not open: call open(streams) first")
        channel = self._audience.channels.get(camera)
        if channel is None:
            raise unknown("camera on the bus", camera, self._audience.channels)
        if not self._requests_read:
            self._read_requests(self._socket)
        self._requests_read = False
        return self._socket, channel

    def close(self) -> dict[str, Any]:
        """Send the totals to the subscribers, then release the port. Safe to call twice."""
        if self._socket is not None:
            try:
                self._send_end(self._socket)
            finally:
                self._release()
        return {
            "type": "zmq",
            "address": self._address,
            **self._sent,
            **self._unsent,
            **(self._auxiliary_sent if self._has_auxiliary else {}),
            **self._ports.report,
        }

    def _await_subscribers(self, server: Socket) -> None:
        deadline_s = monotonic_s() + self._wait_s
        self._read_requests(server)
        while self.subscribers < self._wait_for:
            remaining_s = deadline_s - monotonic_s()
            if remaining_s <= 0:
                raise EvsError(
                    f"{self.subscribers} of {self._wait_for} subscribers came to {self._address} "
                    f"within {self._wait_s:g} s: start them first, e.g. evs echo {self._address}"
                )
            self._ports.poll(min(1000, max(1, int(remaining_s * 1000))))
            self._read_requests(server)

    def _read_requests(self, server: Socket) -> None:
        """Read new and ended subscriptions, and the requests at the other ports."""
        self._ports.poll_requests()
        for _ in range(_MOST_REQUESTS):
            if not readable(server):
                break
            self._audience.take(b"".join(receive_parts(server)))

    def _send(
        self,
        server: Socket,
        channel: Channel,
        topic: Topic,
        header: bytes,
        raw: memoryview | None = None,
    ) -> None:
        self.meter.lap("pack")
        name = channel.topics[topic]
        # a full queue drops it for that subscriber only; copied, since the sender goes on
        if raw is None:
            send_parts(server, (name, header))
            self._sent["bytes_sent"] += len(name) + len(header)
        else:
            send_parts(server, (name, header, self._buffers.copied(raw)))
            self._sent["bytes_sent"] += len(name) + len(header) + raw.nbytes

    def _send_status(self, server: Socket, channel: Channel, *, end: bool) -> None:
        if channel.listeners[STATUS]:
            status = channel.status(self._audience.cameras, end=end)
            self._send(server, channel, STATUS, encode_status(status))
            self._sent["statuses_sent"] += 1

    def _send_clock(self, server: Socket, t_us: int) -> None:
        """Once a tick, and not again for the tick's other cameras."""
        if t_us != self._clock_us:
            self._clock_us = t_us
            send_parts(server, (CLOCK.of(""), encode_clock(Clock(t_us))))

    def _send_end(self, server: Socket) -> None:
        """Repeat every camera's end status until no client listens or the time is up.

        A full queue drops a status like any packet, so sending it once is not enough.
        """
        deadline_s = monotonic_s() + self._linger_s
        self._read_requests(server)
        if self._ports.watched:
            # no state follows, and ZeroMQ may lose one (latest.py)
            for _ in range(2):
                self._ports.publish_state(end=True)
                self._ports.poll(_REPEAT_MS)
        while self._audience.anybody:
            for channel in self._audience.channels.values():
                self._send_status(server, channel, end=True)
            if monotonic_s() >= deadline_s:
                break
            self._ports.poll(_REPEAT_MS)
            self._read_requests(server)

    def _release(self) -> None:
        # what is still queued belongs to subscribers that did not read for the whole linger time
        self._ports.close()
        self._socket = None
