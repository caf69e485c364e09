"""Ros2Publisher: a sink that nodes of ROS 2 take for an event camera's driver."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.files.bags.names import FRAME_KEYS, FrameIds, check_tree, frame_ids, node_path
from evs.drivers.ros2.event_messages import EventMessageBuilder, check_size, check_start
from evs.drivers.ros2.messages import Messages, clock_message, rehearse, static_message
from evs.drivers.ros2.middleware import Participant, checked_domain, interface_of, load
from evs.drivers.ros2.names import GLOBAL, PRIVATE, Quality, quality_of
from evs.drivers.ros2.sender import Sender, TopicQueue, Write
from evs.drivers.sink import Sink, Stream
from evs.drivers.sink_config import Ros2Sink
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, Pose, StreamInfo, unknown


def to_stderr(line: str) -> None:
    """Write one line, also while a progress bar is drawn."""
    sys.stderr.write(line + "\n")


class Statistics:
    """Counts of one camera since its last line; "in" counts 16 bytes for each event."""

    def __init__(
        self,
        node: str,
        interval_s: float,
        log: Callable[[str], None] = to_stderr,
        clock: Callable[[], float] = monotonic_s,
    ) -> None:
        """Start with no packets.

        Args:
            node: Name of the node, such as /camera.
            interval_s: Wall-clock time between lines, s; 0: no lines.
            log: Receives each line.
            clock: The wall clock, s.

        Raises:
            EvsError: The interval is negative or too long.
        """
        if not 0 <= interval_s <= 1e9:
            raise EvsError(
                f"statistics_print_interval is {interval_s:g}: give the seconds, 0 for no lines"
            )
        self._logger = node.strip("/").replace("/", ".")
        self._interval_s, self._log, self._clock = interval_s, log, clock
        self._begin_s: float | None = None
        self._bytes = self._packets = self._sent = self._dropped = 0

    def add(self, t_us: int, size: int, sent: int, dropped: int) -> None:
        """Count one packet, and log the line if it is due.

        Args:
            t_us: End of the packet, us.
            size: Its size, bytes.
            sent: Event messages sent since the start.
            dropped: Event messages dropped since the start.
        """
        if not self._interval_s:
            return
        if self._begin_s is None:
            self._begin_s = self._clock()
        self._bytes += size
        self._packets += 1
        elapsed_s = self._clock() - self._begin_s
        if elapsed_s < self._interval_s:
            return
        out, lost = sent - self._sent, dropped - self._dropped
        seconds, rest_us = divmod(t_us, 1_000_000)
        self._log(
            f"[INFO] [{seconds}.{rest_us:06d}000] [{self._logger}]: "
            f"bw in: {1e-6 * self._bytes / elapsed_s:9.5f} MB/s, "
            f"msgs/s in: {self._packets / elapsed_s:7.0f}, out: {out / elapsed_s:7.0f}"
            + (f", dropped: {lost}" if lost else "")
        )
        self._begin_s += elapsed_s
        self._bytes = self._packets = 0
        self._sent, self._dropped = sent, dropped


INFO_PERIOD_US = 100_000
"""How often camera_info is published where no images are."""


class Connection(Protocol):
    """A presence in ROS 2 that makes writers: middleware.Participant, or a node of rclpy."""

    def writer(self, name: str, kind: str, quality: Quality) -> Write:
        """Make a writer.

        Args:
            name: Full name of the topic, such as /camera/events.
            kind: Type of its messages, such as sensor_msgs/msg/Imu.
            quality: Its quality of service.
        """

    def close(self) -> None:
        """Leave, once all writers are closed."""


class Topic:
    """A topic and its readers at the last check."""

    def __init__(self, name: str, queue: TopicQueue, readers: int = 0) -> None:
        self.name, self.queue, self.readers = name, queue, readers


@dataclass
class Node:
    """One camera's part of a sink."""

    stream: StreamInfo
    path: str
    """/NAMESPACE/NODE"""
    messages: Messages
    builder: EventMessageBuilder
    statistics: Statistics
    topics: dict[str, Topic]
    """name behind the path -> topic; only those that the camera has something for"""
    info_due_us: int = -(2**62)
    time_end_us: int = -(2**62)
    """of its last packet"""

    def listened(self, name: str) -> bool:
        """Return whether a reader of the topic was there at the last check."""
        topic = self.topics.get(name)
        return topic is not None and topic.readers > 0

    def info_is_due(self, t_us: int) -> bool:
        """Return whether camera_info is due at t_us; with images it comes with each of them."""
        if self.stream.frames or not self.listened("camera_info") or t_us < self.info_due_us:
            return False
        self.info_due_us = t_us - t_us % INFO_PERIOD_US + INFO_PERIOD_US
        return True


LINGER_S = 2.0
"""How long a closing sink sends what still waits."""

_POLL_S = 0.02

_SETTLE_S = 0.2


class Ros2Publisher(Sink):
    """A Sink that publishes each camera's topics as metavision_driver and libcaer_driver do.

    Behind /NAMESPACE/NODE: events, imu, camera_info, image_raw, pose; for all: /clock, /tf and
    /tf_static. Their quality of service is the drivers' (names.py), unless `reliable` is given.
    Nothing is encoded for a topic without a reader. Messages leave by a thread, through a queue of
    `send_queue_size` a topic that drops its oldest: the camera never waits. Stamps are simulated
    time, and none is later than the last /clock, which runs back only where the run's own time
    does (a loop's reset). Only this machine is served unless `insecure`.
    """

    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.IMU, Stream.POSE})

    def __init__(
        self,
        *,
        linger_s: float = LINGER_S,
        connect: Callable[[], Connection] | None = None,
        **keys: Any,
    ) -> None:
        """Make a publisher, which `open` opens.

        Args:
            linger_s: How long `close` sends what still waits, s.
            connect: Called when the sink is opened; writers come from what it returns instead of a
                DDS participant: domain_id, interface and insecure then have no effect.
            **keys: Those of Ros2Sink, except of the sensor.

        Raises:
            EvsError: A value that cannot be, or the extra is not installed.
        """
        config = Ros2Sink(**keys)
        for name, value, least in (
            ("send_queue_size", config.send_queue_size, 1),
            ("wait_for", config.wait_for, 0),
            ("wait_s", config.wait_s, 0),
            ("linger_s", linger_s, 0),
        ):
            if not value >= least:
                raise EvsError(f"{name} is {value:g}: give {least} or more")
        self._thresholds = (
            config.event_message_time_threshold,
            config.event_message_size_threshold,
        )
        if connect is None:
            load()
        # wrong values are reported now, and not once the world is loaded
        EventMessageBuilder(config.encoding, *self._thresholds)
        Statistics("", config.statistics_print_interval)
        self._config, self._linger_s = config, linger_s
        self._domain_id = checked_domain(config.domain_id)
        self._interface = interface_of(config.interface, config.insecure)
        self._connect = connect
        self._frame_ids = {key: getattr(config, key) for key in FRAME_KEYS}
        # with tf = false, a URDF has the frames
        static = config.tf if config.tf_static is None else config.tf_static
        self._globals = {"/clock": config.clock, "/tf": config.tf, "/tf_static": static}
        self._connection: Connection | None = None
        self._sender = Sender()
        self._nodes: dict[str, Node] = {}
        self._shared: dict[str, Topic] = {}
        self._pending: list[tuple[int, Topic, Callable[[], bytes]]] = []
        self._clock_us = -(2**62)
        self._unread = 0

    @property
    def readers(self) -> int:
        """Readers of events at the last check, which is at each packet."""
        return sum(node.topics["events"].readers for node in self._nodes.values())

    @property
    def dropped(self) -> tuple[int, int]:
        """Messages dropped so far, and events in them."""
        of_events = [node.topics["events"].queue.counts for node in self._nodes.values()]
        return (
            sum(topic.queue.counts.dropped for topic in self._topics()),
            sum(one.elements_dropped for one in of_events),
        )

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Enter the domain and wait for readers.

        Args:
            streams: One for each camera.

        Raises:
            EvsError: A name, a size or the interface is not valid, or too few readers came in time.
        """
        if self._connection is not None:
            raise EvsError("this ROS 2 sink is open already: close it first, or make another")
        paths = [self._path(stream, len(streams)) for stream in streams]
        if len(set(paths)) < len(paths):
            raise EvsError(f"two cameras would be one ROS node: {', '.join(paths)}; name them")
        rehearse()
        self._sender, self._nodes, self._shared, self._pending = Sender(), {}, {}, []
        self._clock_us = -(2**62)
        if self._connect is None:
            self._connection = Participant(self._domain_id, self._interface)
        else:
            self._connection = self._connect()
        try:
            for shared, kind in GLOBAL.items():
                if self._globals[shared]:
                    self._shared[shared] = self._topic("", shared, kind)
            for stream, path in zip(streams, paths, strict=True):
                self._nodes[stream.camera] = self._make_node(stream, path)
            self._sender.start()
            self._send_static()
            self._await_readers()
        except BaseException:
            self._release()
            raise

    def write(self, packet: EventPacket) -> None:
        """Publish the time, pending auxiliary messages, and the events once enough are gathered."""
        node = self._of(packet.camera)
        end_us = packet.time_end_us
        if end_us < node.time_end_us:
            self._begin_anew(node, end_us)
        node.time_end_us = end_us
        if end_us > self._clock_us:
            self._clock_us = end_us
            self._update_readers()
            clock = self._shared.get("/clock")
            if clock is not None and clock.readers:
                self._send(clock, clock_message(end_us))
        self._send_pending(end_us)
        if node.info_is_due(end_us):
            self._send(node.topics["camera_info"], node.messages.info(end_us))
        events = node.topics["events"]
        if events.readers:
            for message in node.builder.add(packet):
                self._send(
                    events, node.messages.events(message, self._config.encoding), message.events
                )
        else:
            # a later reader receives no earlier events
            node.builder.rest()
            self._unread += 1
        counts = events.queue.counts
        node.statistics.add(end_us, packet.events.nbytes, counts.sent, counts.dropped)

    def write_frame(self, frame: Frame) -> None:
        """Publish an image and its camera_info, with the packet of the tick."""
        node = self._of(frame.camera)
        begin_us = frame.exposure_begin_us
        if node.listened("camera_info"):
            self._later(begin_us, node.topics["camera_info"], lambda: node.messages.info(begin_us))
        if node.listened("image_raw"):
            self._later(begin_us, node.topics["image_raw"], lambda: node.messages.image(frame))

    def write_imu(self, packet: ImuPacket) -> None:
        """Publish a message a sample, with the packet of the tick."""
        node = self._of(packet.camera)
        if node.listened("imu"):
            for sample in packet.samples:
                self._later(int(sample["t"]), node.topics["imu"], _sample(node, sample))

    def wants_pose(self, camera: str) -> bool:
        """Return whether this pose or /tf has readers."""
        return self._of(camera).listened("pose") or self._tf_is_read

    def write_pose(self, pose: Pose) -> None:
        """Publish a pose, as such and for tf, with the packet of the tick."""
        node = self._of(pose.camera)
        if node.listened("pose"):
            self._later(pose.t_us, node.topics["pose"], lambda: node.messages.pose(pose))
        if self._tf_is_read:
            self._later(pose.t_us, self._shared["/tf"], lambda: node.messages.transform(pose))

    def flush(self, seconds: float = LINGER_S) -> None:
        """Wait, for so long at most, until all that was written so far has left."""
        self._sender.flush(seconds)

    def close(self) -> dict[str, Any]:
        """Send what still waits, `linger_s` at most, then leave. Safe to call twice."""
        if self._connection is not None:
            try:
                self._send_pending(2**62)
                for node in self._nodes.values():
                    self._send_gathered(node)
            finally:
                self._release()
        topics = self._topics()
        counts = [topic.queue.counts for topic in topics]
        of_events = [node.topics["events"].queue.counts for node in self._nodes.values()]
        messages_dropped, events_dropped = self.dropped
        return {
            "type": "ros2",
            "domain_id": self._domain_id,
            "interface": str(self._interface),
            "messages_sent": {t.name: t.queue.counts.sent for t in topics if t.queue.counts.sent},
            "bytes_sent": sum(one.bytes for one in counts),
            "packets_unread": self._unread,
            "messages_dropped": messages_dropped,
            "events_sent": sum(one.elements for one in of_events),
            "events_dropped": events_dropped,
        }

    @property
    def _tf_is_read(self) -> bool:
        transforms = self._shared.get("/tf")
        return transforms is not None and transforms.readers > 0

    def _path(self, stream: StreamInfo, count: int) -> str:
        for key, name in {"node": self._config.node, **self._frame_ids}.items():
            if name and count > 1:
                raise EvsError(
                    f"{key} is '{name}', but there are {count} cameras: leave it out, then each "
                    "has its own name, and give a namespace"
                )
        check_size(self._config.encoding, stream.width, stream.height, stream.camera)
        check_start(stream.start_us, stream.camera)
        return node_path(self._config.node, self._config.namespace, stream.camera)

    def _make_node(self, stream: StreamInfo, path: str) -> Node:
        frames = self._frames(path)
        messages = Messages(stream, frames, self._config.world_frame)
        has = {"imu": stream.imu, "image_raw": stream.frames, "camera_info": messages.has_info}
        topics = {
            topic: self._topic(f"{path}/", topic, kind)
            for topic, kind in PRIVATE.items()
            if has.get(topic, True)
        }
        builder = EventMessageBuilder(self._config.encoding, *self._thresholds, stream.start_us)
        statistics = Statistics(path, self._config.statistics_print_interval)
        return Node(stream, path, messages, builder, statistics, topics)

    def _frames(self, path: str) -> FrameIds:
        frames = frame_ids(path, **self._frame_ids)
        if self._globals["/tf"] or self._globals["/tf_static"]:
            check_tree(frames, self._config.world_frame if self._globals["/tf"] else None)
        return frames

    def _topic(self, path: str, name: str, kind: str) -> Topic:
        assert self._connection is not None
        quality = quality_of(name, self._config.reliable, self._config.send_queue_size)
        writer = self._connection.writer(path + name, kind, quality)
        return Topic(path + name, self._sender.add_queue(writer, self._config.send_queue_size))

    def _send_static(self) -> None:
        """Publish the static transforms; readers that come later get them too."""
        topic = self._shared.get("/tf_static")
        if topic is not None:
            nodes = self._nodes.values()
            found = [node.messages.static_transforms(node.stream.start_us) for node in nodes]
            self._send(topic, static_message([one for some in found for one in some]))

    def _topics(self) -> list[Topic]:
        private = [topic for node in self._nodes.values() for topic in node.topics.values()]
        return [*private, *self._shared.values()]

    def _of(self, camera: str) -> Node:
        if self._connection is None:
            raise EvsError("this ROS 2 sink is not open: call open(streams) first")
        node = self._nodes.get(camera)
        if node is None:
            raise unknown("camera of this ROS 2 sink", camera, self._nodes)
        return node

    def _update_readers(self) -> None:
        """Count the readers of each topic."""
        for topic in self._topics():
            topic.readers = topic.queue.writer.readers

    def _later(self, t_us: int, topic: Topic, make: Callable[[], bytes]) -> None:
        """Keep a message until the clock has reached its stamp."""
        self._pending.append((t_us, topic, make))

    def _send_pending(self, t_us: int) -> None:
        due = [one for one in self._pending if one[0] <= t_us]
        if due:
            self._pending = [one for one in self._pending if one[0] > t_us]
            for _, topic, make in due:
                self._send(topic, make())

    def _send(self, topic: Topic, data: bytes, elements: int = 1) -> None:
        self.meter.lap("pack")
        self._sender.put(topic.queue, data, elements)

    def _send_gathered(self, node: Node) -> None:
        for message in node.builder.rest():
            data = node.messages.events(message, self._config.encoding)
            self._send(node.topics["events"], data, message.events)

    def _begin_anew(self, node: Node, end_us: int) -> None:
        """Time was set back, as by a loop's reset: what is of before leaves, the clock follows."""
        self._send_gathered(node)
        # the old one counts wraps of the sensor's clock since its last event
        node.builder = EventMessageBuilder(
            self._config.encoding, *self._thresholds, node.stream.start_us
        )
        node.info_due_us = -(2**62)
        # the first of several cameras sets it back for all
        if self._clock_us >= node.time_end_us:
            before = [one for one in self._pending if one[0] > end_us]
            self._pending = [one for one in self._pending if one[0] <= end_us]
            for _, topic, make in before:
                self._send(topic, make())
            self._clock_us = -(2**62)

    def _await_readers(self) -> None:
        deadline_s = monotonic_s() + self._config.wait_s
        self._update_readers()
        while (came := self.readers) < self._config.wait_for:
            if monotonic_s() >= deadline_s:
                names = ", ".join(node.topics["events"].name for node in self._nodes.values())
                raise EvsError(
                    f"{came} of {self._config.wait_for} readers of {names} came within "
                    f"{self._config.wait_s:g} s: start them while this waits, on the same "
                    "domain_id and interface, or give wait_s more"
                )
            sleep_s(_POLL_S)
            self._update_readers()
        if self._config.wait_for:
            # they may know of us a little later than we of them
            sleep_s(_SETTLE_S)
            self._update_readers()

    def _release(self) -> None:
        self._sender.close(self._linger_s)
        for topic in self._topics():
            topic.queue.writer.close()
        if self._connection is not None:
            self._connection.close()
            self._connection = None


def _sample(node: Node, sample: Any) -> Callable[[], bytes]:
    return lambda: node.messages.sample(sample)
