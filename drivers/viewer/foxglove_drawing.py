"""Foxglove's server and MCAP files. The only door to foxglove-sdk (extra `foxglove`)."""

from __future__ import annotations

import json
import logging
import struct
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.clock import sleep_s
from evs.drivers.files.bags.library import DEFINITIONS, PACKET
from evs.drivers.files.paths import target_error
from evs.drivers.ros2.event_messages import (
    EventMessage,
    EventMessageBuilder,
    check_size,
    check_start,
)
from evs.drivers.sink import Stream
from evs.drivers.viewer.outbox import MAX_QUEUE_BYTES, Letter, Outbox
from evs.drivers.viewer.time_windows import Window
from evs.msgs import EventPacket, EvsError, Frame, Pose, StreamInfo
from evs.msgs.frame import FRAME_ENCODINGS
from evs.msgs.pictures import OFF_RGB, ON_RGB, PAPER

WORLD_FRAME = "world"
"""The reference frame of the poses, as on ROS 2."""

TRANSFORMS = "/tf"
"""The topic of all cameras' poses."""

LINGER_S = 2.0
"""How long a closing server sends what still waits."""

_GRACE_S = 0.5
"""How long it then stays: a server that stops discards what its clients have not read yet."""

_MESSAGE_BYTES = 1_000_000
"""An event message of this size leaves before its time has passed."""

_LEAST_BACKLOG = 64

_SLOW_CLIENTS = "foxglove.websocket.connected_client.send_lossy"
"""The SDK's logger of clients whose queue is full."""

_COLOURS = np.array([(PAPER, PAPER, PAPER), OFF_RGB, ON_RGB], np.uint8)
"""of NOTHING, OFF, ON (time_windows.py)"""

_HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
"""what the definition of a packet refers to, as MCAP's ros2msg has it"""

_RATE = {
    "type": "object",
    "title": "evs.EventRate",
    "properties": {
        "on": {"type": "number", "description": "ON events per simulated second"},
        "off": {"type": "number", "description": "OFF events per simulated second"},
    },
}


def need_foxglove() -> Any:
    """The foxglove module; EvsError with the fix where it is not installed."""
    try:
        import foxglove
        import foxglove.channels
        import foxglove.messages
    except ImportError:
        raise EvsError("Foxglove's SDK is not installed: pip install 'evs[foxglove]'") from None
    return foxglove


class FoxgloveDrawing:
    """The topics of all cameras, for Foxglove's clients or in an MCAP file.

    Under each camera's name: event_image, event_rate, events (event_camera_msgs/EventPacket),
    image_raw, luminance, camera_info; the poses of all are /tf. Times are simulated time. Messages
    leave by a thread (Outbox).
    """

    def __init__(self, queue: int, encoding: str, period_us: int, *, lossless: bool) -> None:
        """Make one that neither serves nor writes.

        Args:
            queue: Messages that may wait.
            encoding: Of the events, a key of PAYLOADS.
            period_us: Simulated time that an event message spans, us.
            lossless: Whether the camera waits where the queue is full, instead of dropping.
        """
        self._foxglove = need_foxglove()
        self._context = self._foxglove.Context()
        self._queue, self._encoding, self._period_us = queue, encoding, period_us
        self._cameras: dict[str, _Topics] = {}
        self._transforms: Any = None
        self._file: _File | None = None
        self._writer: Any = None
        self._server: Any = None
        self._listener = _Listener()
        self._overflows = _LineCounter()
        self._outbox = Outbox(queue, lossless=lossless)
        self._time_us = -1

    def to_file(self, path: Path, streams: Sequence[StreamInfo]) -> None:
        """Write an MCAP file. EvsError: it cannot be created, or a stream does not fit."""
        self._check(streams)
        try:
            self._file = _File(path)
        except OSError as reason:
            raise target_error(path, reason) from None
        # chunks are compressed by our thread, and not by one more on each core
        options = self._foxglove.mcap.MCAPWriteOptions(disable_seeking=True, compression_threads=0)
        self._writer = self._foxglove.open_mcap(
            self._file, context=self._context, writer_options=options
        )
        self._describe(streams)

    def to_clients(self, host: str, port: int, streams: Sequence[StreamInfo]) -> None:
        """Serve Foxglove's WebSocket protocol. EvsError: the port is in use."""
        self._check(streams)
        self._describe(streams)
        logger = logging.getLogger(_SLOW_CLIENTS)
        logger.setLevel(logging.INFO)
        logger.addHandler(self._overflows)
        largest = max((3 * one.width * one.height for one in streams), default=1)
        backlog = max(_LEAST_BACKLOG, min(self._queue, MAX_QUEUE_BYTES // largest))
        try:
            self._server = self._foxglove.start_server(
                name="evs",
                host=host,
                port=port,
                capabilities=[self._foxglove.websocket.Capability.Time],
                server_listener=self._listener,
                context=self._context,
                message_backlog_size=backlog,
            )
        except RuntimeError as reason:
            raise EvsError(
                f"cannot serve Foxglove on {host}, port {port}: {reason}; give another address"
            ) from None

    @property
    def port(self) -> int:
        """The TCP port of the server; 0 without one."""
        return 0 if self._server is None else int(self._server.port)

    @property
    def clients(self) -> int:
        """Clients that have subscribed to anything so far."""
        return len(self._listener.clients)

    @property
    def overflow_notices(self) -> int:
        """Notices of the SDK that a client's queue was full; it gives one in 30 s at most."""
        return self._overflows.lines

    def wait_for_clients(self, count: int, seconds: float) -> bool:
        """Wait for a number of subscribers; return False if they do not come in time."""
        return self._listener.wait(count, seconds)

    @property
    def counts(self) -> dict[str, int]:
        """Messages that left and were dropped."""
        counts = self._outbox.counts
        return {
            "messages_sent": counts.sent,
            "bytes_sent": counts.bytes,
            "messages_dropped": counts.dropped,
            "events_dropped": counts.events_dropped,
        }

    @property
    def failure(self) -> str:
        """Why writing the file stopped; empty if it did not."""
        return "" if self._file is None else self._file.failure

    def wants(self, stream: Stream, camera: str) -> bool:
        """Whether a client subscribes to a stream; a file takes everything."""
        topics = self._cameras[camera]
        channels = {
            Stream.EVENTS: (topics.image, topics.rate, topics.info),
            Stream.FRAMES: (topics.frames,),
            Stream.LIGHT: (topics.luminance,),
            Stream.POSE: (self._transforms,),
        }[stream]
        return any(one is not None and one.has_sinks() for one in channels)

    def events(self, packet: EventPacket) -> None:
        """The events as event_camera_msgs/EventPacket, one message a period."""
        topics = self._cameras[packet.camera]
        if packet.time_end_us < topics.end_us:
            self._begin_anew(topics, packet.time_end_us)
        topics.end_us = packet.time_end_us
        self._tell_time(packet.time_end_us)
        if topics.packets.has_sinks():
            self._send_messages(topics, topics.builder.add(packet), packet.time_end_us)
        else:
            # a later subscriber receives no earlier events
            topics.builder.rest()

    def window(self, window: Window) -> None:
        """Events as an image, rates, and the calibration of the camera with them."""
        topics, t_us = self._cameras[window.camera], window.end_us
        stream = topics.stream
        if topics.image.has_sinks():
            height, width = window.picture.shape
            self._send_image(
                topics.image,
                topics,
                t_us,
                t_us,
                "rgb8",
                (height, width, 3),
                lambda: _COLOURS.take(window.picture, axis=0).tobytes(),
            )
        if topics.rate.has_sinks():
            rates = json.dumps({"on": window.on_hz, "off": window.off_hz}).encode()
            self._send(topics.rate, rates, len(rates), t_us)
        if topics.info is not None and topics.info.has_sinks():
            info = stream.camera_info
            message = self._foxglove.messages.CameraCalibration(
                timestamp=self._stamp(t_us),
                frame_id=topics.frame_id,
                width=stream.width,
                height=stream.height,
                distortion_model=str(info.get("distortion_model", "")),
                **{name.upper(): [float(value) for value in info[name]] for name in "dkrp"},
            )
            self._send(topics.info, message, 300, t_us)

    def frame(self, frame: Frame) -> None:
        """An intensity frame, stamped with the start of its exposure as ROS's are."""
        topics = self._cameras[frame.camera]
        (name,) = (n for n, dtype in FRAME_ENCODINGS.items() if dtype == frame.pixels.dtype)
        # the memory of the pixels may be used again
        data, shape = frame.pixels.tobytes(), (*frame.pixels.shape, frame.pixels.itemsize)
        begin_us = frame.exposure_begin_us
        self._send_image(topics.frames, topics, frame.end_us, begin_us, name, shape, lambda: data)

    def luminance(self, camera: str, t_us: int, picture: npt.NDArray[np.uint8]) -> None:
        """The light on the sensor, (h, w), as it is shown."""
        topics = self._cameras[camera]
        shape = (*picture.shape, 1)
        self._send_image(topics.luminance, topics, t_us, t_us, "mono8", shape, picture.tobytes)

    def pose(self, pose: Pose) -> None:
        """The camera's optical frame in the world's."""
        kinds = self._foxglove.messages
        x, y, z = map(float, pose.position)
        i, j, k, w = map(float, pose.orientation)
        message = kinds.FrameTransform(
            timestamp=self._stamp(pose.t_us),
            parent_frame_id=WORLD_FRAME,
            child_frame_id=self._cameras[pose.camera].frame_id,
            translation=kinds.Vector3(x=x, y=y, z=z),
            rotation=kinds.Quaternion(x=i, y=j, z=k, w=w),
        )
        self._send(self._transforms, message, 150, pose.t_us)

    def close(self) -> None:
        """Send what waits (to clients, for LINGER_S at most), then end the file or the server."""
        try:
            for topics in self._cameras.values():
                if topics.packets.has_sinks():
                    self._send_messages(topics, topics.builder.rest(), topics.end_us)
        finally:
            self.release()

    def release(self) -> None:
        """End the file or the server, however far they came."""
        try:
            self._outbox.close(None if self._server is None else LINGER_S)
        finally:
            if self._server is not None:
                if self.clients:
                    sleep_s(_GRACE_S)
                # it waits for a client that reads nothing, without end
                stopping = threading.Thread(target=self._server.stop, daemon=True)
                stopping.start()
                stopping.join(LINGER_S)
                logging.getLogger(_SLOW_CLIENTS).removeHandler(self._overflows)
            if self._writer is not None:
                # a writer whose file has failed has nothing to complete
                with suppress(RuntimeError):
                    self._writer.close()
            if self._file is not None:
                self._file.close()
            for topics in self._cameras.values():
                topics.close()

    def _check(self, streams: Sequence[StreamInfo]) -> None:
        for stream in streams:
            check_size(self._encoding, stream.width, stream.height, stream.camera)
            check_start(stream.start_us, stream.camera)

    def _describe(self, streams: Sequence[StreamInfo]) -> None:
        """Create the channels of each camera."""
        foxglove, context = self._foxglove, self._context
        kinds = foxglove.channels
        definition = (DEFINITIONS[PACKET] + _HEADER.lstrip("\n")).encode()
        schema = foxglove.Schema(name=PACKET, encoding="ros2msg", data=definition)
        for stream in streams:
            root, info = f"/{stream.camera}", stream.camera_info
            optics = {"d", "k", "r", "p"} <= set(info)
            self._cameras[stream.camera] = _Topics(
                stream,
                f"{stream.camera}_optical_frame",
                kinds.RawImageChannel(f"{root}/event_image", context=context),
                foxglove.Channel(f"{root}/event_rate", schema=_RATE, context=context),
                foxglove.Channel(
                    f"{root}/events", schema=schema, message_encoding="cdr", context=context
                ),
                kinds.RawImageChannel(f"{root}/luminance", context=context),
                kinds.RawImageChannel(f"{root}/image_raw", context=context)
                if stream.frames
                else None,
                kinds.CameraCalibrationChannel(f"{root}/camera_info", context=context)
                if optics
                else None,
                self._builder(stream),
            )
        self._transforms = kinds.FrameTransformChannel(TRANSFORMS, context=context)

    def _builder(self, stream: StreamInfo) -> EventMessageBuilder:
        period_s = 1e-6 * self._period_us
        return EventMessageBuilder(self._encoding, period_s, _MESSAGE_BYTES, stream.start_us)

    def _begin_anew(self, topics: _Topics, t_us: int) -> None:
        """Time was set back, as by a loop's reset: clients forget what came before."""
        self._send_messages(topics, topics.builder.rest(), topics.end_us)
        topics.builder = self._builder(topics.stream)
        # the first of several cameras sets it back for all
        if self._time_us > t_us:
            self._time_us = -1
            if self._server is not None:
                self._outbox.put(Letter(self._server.clear_session, 0))

    def _tell_time(self, t_us: int) -> None:
        """Clients have no other clock than ours: once a period."""
        if self._server is None or 0 <= t_us < self._time_us + self._period_us:
            return
        self._time_us = t_us
        if self.clients:
            self._outbox.put(Letter(partial(self._server.broadcast_time, 1000 * t_us), 8))

    def _send_messages(self, topics: _Topics, messages: Sequence[Any], t_us: int) -> None:
        stream = topics.stream
        for message in messages:
            data = packet_message(
                message,
                topics.seq,
                stream.width,
                stream.height,
                self._encoding,
                topics.frame_id,
            )
            topics.seq += 1
            self._send(topics.packets, data, len(data), t_us, message.events)

    def _send_image(
        self,
        channel: Any,
        topics: _Topics,
        t_us: int,
        stamp_us: int,
        encoding: str,
        shape: tuple[int, ...],
        pixels: Callable[[], bytes],
    ) -> None:
        """Send an image of (rows, columns, bytes of a pixel); `pixels` is called by the thread."""
        height, width, pixel_bytes = shape

        def send() -> None:
            image = self._foxglove.messages.RawImage(
                timestamp=self._stamp(stamp_us),
                frame_id=topics.frame_id,
                width=width,
                height=height,
                encoding=encoding,
                step=width * pixel_bytes,
                data=pixels(),
            )
            channel.log(image, log_time=1000 * t_us)

        self._outbox.put(Letter(send, height * width * pixel_bytes))

    def _send(self, channel: Any, message: Any, size: int, t_us: int, events: int = 0) -> None:
        self._outbox.put(Letter(partial(channel.log, message, log_time=1000 * t_us), size, events))

    def _stamp(self, t_us: int) -> Any:
        seconds, rest = divmod(t_us, 1_000_000)
        return self._foxglove.messages.Timestamp(seconds, 1000 * rest)


class _Topics:
    """One camera's channels."""

    def __init__(
        self,
        stream: StreamInfo,
        frame_id: str,
        image: Any,
        rate: Any,
        packets: Any,
        luminance: Any,
        frames: Any,
        info: Any,
        builder: EventMessageBuilder,
    ) -> None:
        self.stream, self.frame_id = stream, frame_id
        self.image, self.rate, self.packets = image, rate, packets
        self.luminance, self.frames, self.info = luminance, frames, info
        self.builder = builder
        self.seq = 0
        """of the next event message"""
        self.end_us = -(2**62)
        """of the last packet"""

    def close(self) -> None:
        """Close the channels."""
        every = (self.image, self.rate, self.packets, self.luminance, self.frames, self.info)
        for channel in every:
            if channel is not None:
                channel.close()


class _Listener:
    """Counts the clients that subscribe; called by the server's threads."""

    def __init__(self) -> None:
        self.clients: set[int] = set()
        self._changed = threading.Condition()

    def on_subscribe(self, client: Any, _channel: Any) -> None:
        """Note a client."""
        with self._changed:
            self.clients.add(int(client.id))
            self._changed.notify_all()

    def on_unsubscribe(self, _client: Any, _channel: Any) -> None:
        """Nothing: a client that was there counts."""

    def wait(self, count: int, seconds: float) -> bool:
        """Wait for a number of subscribers."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self.clients) >= count, seconds)


class _LineCounter(logging.Handler):
    """Counts lines of a log."""

    def __init__(self) -> None:
        super().__init__()
        self.lines = 0

    def emit(self, record: logging.LogRecord) -> None:  # noqa: ARG002
        """Count one."""
        self.lines += 1


class _File:
    """A file that the SDK's writer writes to; where it cannot grow, the rest is discarded."""

    def __init__(self, path: Path) -> None:
        """Create the file. OSError: it cannot be created."""
        self.failure = ""
        """the operating system's message when writing stopped; empty if it did not"""
        self._file = path.open("wb", buffering=0)
        self._place = 0

    def write(self, data: bytes) -> int:
        """Write all of it, or discard it after a failure."""
        rest = memoryview(data)
        try:
            while rest and not self.failure:
                rest = rest[self._file.write(rest) :]
        except OSError as reason:
            self.failure = reason.strerror or str(reason)
        self._place += len(data)
        return len(data)

    def seek(self, _offset: int, _whence: int = 0) -> int:
        """Return the place: the writer was set not to move it."""
        return self._place

    def flush(self) -> None:
        """Nothing is buffered here."""

    def close(self) -> None:
        """End the file."""
        self._file.close()


def packet_message(
    message: EventMessage, seq: int, width: int, height: int, encoding: str, frame_id: str
) -> bytes:
    """Pack an event_camera_msgs/EventPacket as its CDR, without a library of ROS.

    Args:
        message: The events and their times.
        seq: Number of the message.
        width: Of the sensor, px.
        height: Of the sensor, px.
        encoding: As ROS's codecs call it.
        frame_id: Of the camera.

    Returns:
        Little-endian CDR, with its header of four bytes.
    """
    seconds, rest = divmod(message.first_us, 1_000_000)
    body = struct.pack("<iI", seconds, 1000 * rest) + _text(frame_id)
    body = _aligned(body, 4) + struct.pack("<II", height, width)
    body = _aligned(body, 8) + struct.pack("<QQ", seq, message.time_base_ns) + _text(encoding)
    # is_bigendian, then the events, a sequence of bytes
    body = _aligned(body + b"\0", 4) + struct.pack("<I", len(message.data))
    return b"".join((b"\0\1\0\0", body, message.data))


def _text(text: str) -> bytes:
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def _aligned(body: bytes, size: int) -> bytes:
    return body + bytes(-len(body) % size)
