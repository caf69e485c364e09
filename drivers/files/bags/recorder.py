"""Ros1Recorder and Ros2Recorder: one camera's packets into a ROS bag."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shutil
import sqlite3
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.bags.library import ARRAY, PACKET, TEXT, TRANSFORMS, load, typestore
from evs.drivers.files.bags.messages import (
    EXPOSURE,
    IMAGE,
    INFO,
    POSE,
    SAMPLE,
    TOPICS,
    array_bytes,
    image_message,
    info_message,
    is_calibrated,
    link_transform,
    pose_message,
    sample_message,
    static_transforms,
)
from evs.drivers.files.bags.names import as_name, check_tree, frame_ids, node_path
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.library_recorder import LibraryRecorder
from evs.drivers.sink import Stream
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, Pose, unknown
from evs.msgs.codecs import LAST_ROS_US, PAYLOADS, TIME_ORIGIN_US, PayloadWriter

DVS = "dvs"
"""encoding: dvs_msgs/EventArray instead of an encoding of event_camera_msgs/EventPacket"""

STREAM_TOPIC = "evs_stream"
"""topic in the namespace of the events: a std_msgs/String with the StreamInfo as JSON"""


class _BagRecorder(LibraryRecorder):
    """Writes the topics and frames of a live camera; time stamps are simulated time."""

    ROS: int
    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.IMU, Stream.POSE})
    LIBRARY_ERRORS = (OSError, RuntimeError)

    def __init__(
        self,
        path: AnyPath,
        encoding: str | None = None,
        *,
        node: str = "",
        namespace: str = "",
        camera_frame_id: str = "",
        imu_frame_id: str = "",
        link_frame_id: str = "",
        world_frame: str = "world",
        tf: bool = True,
        tf_static: bool | None = None,
    ) -> None:
        """Make a recorder that is not open yet.

        Args:
            path: The file to write.
            encoding: A key of PAYLOADS (event_camera_msgs), or dvs (dvs_msgs).
            node: Last part of the topics' namespace; the camera's name if empty. ROS 2 only.
            namespace: What comes before it. ROS 2 only.
            camera_frame_id: The optical frame; NODE_optical_frame if empty.
            imu_frame_id: Frame of the IMU samples; NODE_imu_frame if empty.
            link_frame_id: The camera's body; NODE_link if empty.
            world_frame: Reference frame of the poses.
            tf: Whether /tf holds the link in the world.
            tf_static: Whether /tf_static holds the first two frames in the link; None: as tf.
        """
        super().__init__(path)
        load()
        self._limits = self._format.capabilities_for(encoding)
        self._encoding = encoding
        self._node, self._namespace = node, namespace
        self._given_frames = camera_frame_id, imu_frame_id, link_frame_id
        self._frames = frame_ids("")
        self._world_frame = world_frame
        self._tf, self._tf_static = tf, tf if tf_static is None else tf_static
        self._prefix = ""
        self._payloads: PayloadWriter | None = None
        self._store: Any = None
        self._writer: Any = None
        self._topic: Any = None
        self._others: dict[str, Any] = {}
        self._images = 0
        self._imu_samples = 0
        self._poses = 0

    @abstractmethod
    def _open_storage(self, path: Path) -> Storage:
        """Open a file of the library."""

    @abstractmethod
    def _default_encoding(self) -> str:
        """The encoding where none is requested."""

    @abstractmethod
    def _topic_prefix(self, path: str) -> str:
        """What the topics of the node at `path`, as in /robot/camera, begin with."""

    @abstractmethod
    def _connect(self, topic: str, kind: str, *, latched: bool = False) -> Any:
        """Declare a topic; `latched`: a player keeps its messages for later readers."""

    def _create(self, path: Path) -> None:
        encoding = self._encoding or self._default_encoding()
        if encoding not in (*PAYLOADS, DVS):
            raise unknown("encoding", encoding, (*PAYLOADS, DVS))
        clock_us = 0
        if encoding != DVS:
            limits = PAYLOADS[encoding].limits
            if self.stream.width > limits.width or self.stream.height > limits.height:
                size = f"{self.stream.width} x {self.stream.height}"
                raise EvsError(
                    f"cannot record {size} px to {self._path}: {limits.name} holds "
                    f"{limits.width} x {limits.height}; set encoding = libcaer"
                )
            origin_us = TIME_ORIGIN_US - self.stream.start_us
            clock_us = origin_us if PAYLOADS[encoding].has_clock else 0
            self._payloads = PayloadWriter(encoding, time_origin_us=origin_us)
        self._store = typestore(self.ROS)
        path_of_node = node_path(self._node or as_name(self.stream.camera), self._namespace, "")
        self._prefix = self._topic_prefix(path_of_node)
        self._frames = frame_ids(path_of_node, *self._given_frames)
        if self._tf or self._tf_static:
            check_tree(self._frames, self._world_frame if self._tf else None)
        self._storage = self._open_storage(path)
        self._writer = self._storage.writer
        kind = ARRAY if encoding == DVS else PACKET
        self._topic = self._connect(f"{self._prefix}/events", kind)
        description = {
            "stream": dataclasses.asdict(self.stream),
            "time_origin_us": clock_us,
        }
        text = self._store.types[TEXT](data=json.dumps(description, default=str))
        about = self._connect(f"{self._prefix}/{STREAM_TOPIC}", TEXT)
        # ROS has no later time; events after it are refused
        begin_us = min(self.stream.start_us, LAST_ROS_US)
        self._send(about, begin_us, self._serialised(text, TEXT))
        frames, calibrated = self.stream.frames, is_calibrated(self.stream)
        wanted = {IMAGE: frames, EXPOSURE: frames, INFO: frames or calibrated}
        wanted[SAMPLE] = self.stream.imu
        for kind, is_wanted in wanted.items():
            if is_wanted:
                self._others[kind] = self._connect(f"{self._prefix}/{TOPICS[kind]}", kind)
        if calibrated and not frames:
            self._send_info(begin_us, begin_us)
        if self._tf_static:
            self._send_static(begin_us)

    def _send_info(self, stamp_us: int, t_us: int) -> None:
        """Send the camera_info with this stamp, at this time of the bag."""
        info = info_message(self._store, self._header(stamp_us), self.stream, self.ROS)
        self._send(self._others[INFO], t_us, self._serialised(info, INFO))

    def _send_static(self, t_us: int) -> None:
        header = self._header(t_us, self._frames.link)
        found = static_transforms(self._store, header, self._frames, self.stream.imu)
        message = self._store.types[TRANSFORMS](transforms=found)
        topic = self._connect("/tf_static", TRANSFORMS, latched=True)
        self._send(topic, t_us, self._serialised(message, TRANSFORMS))

    def _write_packet(self, packet: EventPacket) -> None:
        events, stream = packet.events, self.stream
        first_us, last_us = int(events["t"][0]), int(events["t"][-1])
        if self._payloads is None:
            sides = stream.height, stream.width
            data: bytes | memoryview = array_bytes(
                events, self.ROS, self._packets, self._frames.camera, *sides
            )
        else:
            base_ns, payload = self._payloads.payload(events)
            message = self._store.types[PACKET](
                header=self._header(first_us),
                height=stream.height,
                width=stream.width,
                seq=self._packets,
                time_base=base_ns,
                encoding=self._payloads.encoding,
                is_bigendian=False,
                events=np.frombuffer(payload, np.uint8),
            )
            data = self._serialised(message, PACKET)
        self.meter.lap("pack")
        self._send(self._topic, last_us, data)

    def write_frame(self, frame: Frame) -> None:
        """Write one image, its exposure and its camera_info.

        Errors as `write`; EvsError for undeclared frames.
        """
        self._check_declared(IMAGE, "frames", frame.exposure_begin_us)
        self._reserve(frame.pixels.nbytes)
        with self._library_errors():
            exposure = frame.exposure_end_us - frame.exposure_begin_us
            exposure_message = self._store.types[EXPOSURE](data=min(exposure, 2**31 - 1))
            header = self._header(frame.exposure_begin_us)
            image = image_message(self._store, header, frame)
            for message, kind in ((exposure_message, EXPOSURE), (image, IMAGE)):
                data = self._serialised(message, kind)
                self._send(self._others[kind], frame.end_us, data)
            self._send_info(frame.exposure_begin_us, frame.end_us)
            self._images += 1
        self._sync_if_due(frame.end_us)

    def write_imu(self, packet: ImuPacket) -> None:
        """Write the samples of one packet. Errors as `write`; EvsError for undeclared samples."""
        for sample in packet.samples:
            t_us = int(sample["t"])
            self._check_declared(SAMPLE, "imu", t_us)
            self._reserve(0)
            with self._library_errors():
                header = self._header(t_us, self._frames.imu)
                message = sample_message(self._store, header, sample)
                self._send(self._others[SAMPLE], t_us, self._serialised(message, SAMPLE))
                self._imu_samples += 1
            self._sync_if_due(t_us)

    def write_pose(self, pose: Pose) -> None:
        """Write the pose, as such and for tf. Errors as `write`."""
        self._check_open()
        self._check_stamp("poses", pose.t_us)
        self._reserve(0)
        with self._library_errors():
            if POSE not in self._others:
                # declared late: no recording that is converted has poses
                self._others[POSE] = self._connect(f"{self._prefix}/{TOPICS[POSE]}", POSE)
                if self._tf:
                    self._others[TRANSFORMS] = self._connect("/tf", TRANSFORMS)
            header = self._header(pose.t_us, self._world_frame)
            message = pose_message(self._store, header, pose)
            self._send(self._others[POSE], pose.t_us, self._serialised(message, POSE))
            if self._tf:
                moved = link_transform(self._store, header, self._frames, pose)
                message = self._store.types[TRANSFORMS](transforms=[moved])
                self._send(
                    self._others[TRANSFORMS], pose.t_us, self._serialised(message, TRANSFORMS)
                )
            self._poses += 1
        self._sync_if_due(pose.t_us)

    def _check_declared(self, kind: str, key: str, t_us: int) -> None:
        self._check_open()
        if kind not in self._others:
            raise EvsError(f"{self._path} was opened without {key}: set {key} of its StreamInfo")
        self._check_stamp(key, t_us)

    def _check_stamp(self, what: str, t_us: int) -> None:
        if not 0 <= t_us <= LAST_ROS_US:
            raise EvsError(
                f"cannot record {what} at {t_us} us to {self._path}, as ROS has 0 ... "
                f"{LAST_ROS_US} us: record to .aedat4"
            )

    def close(self) -> dict[str, Any]:
        """As LibraryRecorder's, with the numbers of frames, samples and poses."""
        counts = {"frames": self._images, "imu_samples": self._imu_samples, "poses": self._poses}
        return super().close() | counts

    def _send(self, topic: Any, t_us: int, data: bytes | memoryview) -> None:
        self._writer.write(topic, t_us * 1000, data)

    def _header(self, t_us: int, frame_id: str | None = None) -> Any:
        seconds, rest = divmod(t_us, 1_000_000)
        types = self._store.types
        stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest * 1000)
        sequence = {"seq": self._packets & 0xFFFFFFFF} if self.ROS == 1 else {}
        name = self._frames.camera if frame_id is None else frame_id
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=name, **sequence)

    def _serialised(self, message: Any, kind: str) -> memoryview:
        serialise = self._store.serialize_ros1 if self.ROS == 1 else self._store.serialize_cdr
        data: memoryview = serialise(message, kind)
        return data

    def _sync(self) -> None:
        self._storage.sync()

    def _move_into_place(self, path: Path) -> None:  # noqa: ARG002 - it knows where it is
        self._storage.move_to(self._path)

    def _finish(self) -> None:
        self._storage.close()

    def _discard(self) -> None:
        super()._discard()
        with contextlib.suppress(OSError):
            shutil.rmtree(self._temporary)


class Ros1Recorder(_BagRecorder):
    """A ROS 1 bag: /dvs/events of dvs_msgs/EventArray, unless another encoding is requested."""

    NAME, ROS = "rosbag1", 1

    def _default_encoding(self) -> str:
        return DVS

    def _topic_prefix(self, path: str) -> str:  # noqa: ARG002 - that of rpg_dvs_ros
        return "/dvs"

    def _connect(self, topic: str, kind: str, *, latched: bool = False) -> Any:
        return self._writer.add_connection(
            topic, kind, typestore=self._store, latching=1 if latched else None
        )

    def _open_storage(self, path: Path) -> Storage:
        return Ros1BagFile(path)


class Ros2Recorder(_BagRecorder):
    """A rosbag2 file, MCAP or SQLite: /CAMERA/events of event_camera_msgs/EventPacket.

    EVT3, as real drivers record it, or libcaer where the sensor is too large for that.
    """

    NAME, ROS = "rosbag2", 2

    def _default_encoding(self) -> str:
        limits = PAYLOADS["evt3"].limits
        fits = self.stream.width <= limits.width and self.stream.height <= limits.height
        return "evt3" if fits else "libcaer"

    def _topic_prefix(self, path: str) -> str:
        return path

    def _connect(self, topic: str, kind: str, *, latched: bool = False) -> Any:
        return self._writer.add_connection(
            topic, kind, typestore=self._store, offered_qos_profiles=_latched() if latched else ()
        )

    def _open_storage(self, path: Path) -> Storage:
        if self._path.suffix.lower() == ".db3":
            return SqliteFile(path, self._path.stem)
        return McapFile(path, self._path.stem)


def _latched() -> list[Any]:
    """The quality of service of tf2's static broadcaster, with which a player repeats it."""
    kinds = load().interfaces
    # the longest time that ROS has, as its own recorder writes it
    never = kinds.QosTime(9223372036, 854775807)
    return [
        kinds.Qos(
            history=kinds.QosHistory.KEEP_LAST,
            depth=1,
            reliability=kinds.QosReliability.RELIABLE,
            durability=kinds.QosDurability.TRANSIENT_LOCAL,
            deadline=never,
            lifespan=never,
            liveliness=kinds.QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=never,
            avoid_ros_namespace_conventions=False,
        )
    ]


class Storage(ABC):
    """An open file of the library, adapted so that a killed process leaves a readable file.

    Messages go through `writer`. The library buffers a chunk of 1 MB (MCAP, ROS 1) or a whole
    transaction (SQLite), and makes a folder for rosbag2. `sync` ends the chunk or the transaction;
    `move_to` moves the open file to its final name.
    """

    writer: Any

    @abstractmethod
    def sync(self) -> None:
        """Hand everything to the operating system, so that the file is readable up to here."""

    @abstractmethod
    def move_to(self, target: Path) -> None:
        """Move the file to its final name; it stays open."""

    def close(self) -> None:
        """Write the end of the file and close it."""
        self.writer.close()


class Ros1BagFile(Storage):
    """A ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.writer = load().rosbag1.Writer(path)
        self.writer.open()

    def sync(self) -> None:
        """End the chunk; it contains the connections declared so far."""
        self.writer.write_chunk(self.writer.chunks[-1])
        self.writer.bio.flush()

    def move_to(self, target: Path) -> None:
        """Move the file."""
        self._path.replace(target)


class _Rosbag2Storage(Storage):
    """A file of rosbag2, out of the folder that the library makes for it."""

    def __init__(self, path: Path, name: str, plugin: str) -> None:
        """Create the file.

        Args:
            path: The folder.
            name: Name of the bag in it.
            plugin: MCAP or SQLITE3, of the library's StoragePlugin.
        """
        self._folder = path
        path.mkdir()
        rosbag2 = load().rosbag2
        self.writer = rosbag2.Writer(
            path / name, version=9, storage_plugin=getattr(rosbag2.StoragePlugin, plugin)
        )
        self.writer.open()

    def close(self) -> None:
        """Write the end of the file; the library describes the bag in its folder."""
        self.writer.path.mkdir(parents=True)
        try:
            super().close()
        finally:
            shutil.rmtree(self._folder)


class McapFile(_Rosbag2Storage):
    """An MCAP file, which is complete without its folder."""

    def __init__(self, path: Path, name: str) -> None:
        super().__init__(path, name, "MCAP")

    def sync(self) -> None:
        """End the chunk, if there is anything in it."""
        if self.writer.storage.chunk.bio.tell():
            self.writer.storage.close_chunk()
        self.writer.storage.bio.flush()

    def move_to(self, target: Path) -> None:
        """Move the file out of its folder."""
        self.writer.storage.path.replace(target)
        shutil.rmtree(self._folder)


class SqliteFile(_Rosbag2Storage):
    """An SQLite file; its journal lies next to it while a transaction ends."""

    def __init__(self, path: Path, name: str) -> None:
        super().__init__(path, name, "SQLITE3")

    def sync(self) -> None:
        """End the transaction."""
        self.writer.storage.conn.commit()

    def move_to(self, target: Path) -> None:
        """Move the file, and open it again there, so that its journal lies there too."""
        storage = self.writer.storage
        storage.conn.close()
        for left in (f"{target}-journal", f"{target}-wal", f"{target}-shm"):
            Path(left).unlink(missing_ok=True)
        storage.path.replace(target)
        storage.conn = sqlite3.connect(target)
        # a kill is not a power cut: what the operating system has is safe
        storage.conn.execute("PRAGMA synchronous = OFF")
        storage.conn.execute("PRAGMA cache_spill = OFF")
        storage.cursor = storage.conn.cursor()
        shutil.rmtree(self._folder)
