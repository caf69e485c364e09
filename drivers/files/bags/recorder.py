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

from evs.drivers.files.bags.library import ARRAY, PACKET, TEXT, load, typestore
from evs.drivers.files.bags.messages import (
    EXPOSURE,
    IMAGE,
    INFO,
    SAMPLE,
    TOPICS,
    array_bytes,
    image_message,
    info_message,
    sample_message,
)
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.library_recorder import LibraryRecorder
from evs.drivers.sink import Stream
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, unknown
from evs.msgs.codecs import PAYLOADS, TIME_ORIGIN_US, PayloadWriter

DVS = "dvs"
"""encoding: dvs_msgs/EventArray instead of an encoding of event_camera_msgs/EventPacket"""

STREAM_TOPIC = "evs_stream"
"""topic in the namespace of the events: a std_msgs/String with the StreamInfo as JSON"""


class _BagRecorder(LibraryRecorder):
    """Writes the topics of the real drivers, NAMESPACE/events; time stamps are simulated time."""

    ROS: int
    NAMESPACE: str
    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.IMU})
    LIBRARY_ERRORS = (OSError, RuntimeError)

    def __init__(self, path: AnyPath, encoding: str | None = None) -> None:
        """Make a recorder that is not open yet.

        Args:
            path: The file to write.
            encoding: evt3, libcaer or mono (event_camera_msgs), or dvs (dvs_msgs).
        """
        super().__init__(path)
        load()
        self._limits = self._format.capabilities_for(encoding)
        self._encoding = encoding
        self._payloads: PayloadWriter | None = None
        self._store: Any = None
        self._writer: Any = None
        self._topic: Any = None
        self._others: dict[str, Any] = {}
        self._frames = 0
        self._imu_samples = 0

    @abstractmethod
    def _open_storage(self, path: Path) -> Storage:
        """Open a file of the library."""

    @abstractmethod
    def _default_encoding(self) -> str:
        """The encoding where none is requested."""

    def _create(self, path: Path) -> None:
        encoding = self._encoding or self._default_encoding()
        if encoding not in (*PAYLOADS, DVS):
            raise unknown("encoding", encoding, (*PAYLOADS, DVS))
        if encoding != DVS:
            limits = PAYLOADS[encoding]
            if self.stream.width > limits.width or self.stream.height > limits.height:
                size = f"{self.stream.width} x {self.stream.height}"
                raise EvsError(
                    f"cannot record {size} px to {self._path}: {limits.name} holds "
                    f"{limits.width} x {limits.height}; set encoding = libcaer"
                )
            origin_us = TIME_ORIGIN_US - self.stream.start_us
            self._payloads = PayloadWriter(encoding, time_origin_us=origin_us)
        self._store = typestore(self.ROS)
        self._storage = self._open_storage(path)
        self._writer = self._storage.writer
        kind = ARRAY if encoding == DVS else PACKET
        self._topic = self._connect("events", kind)
        description = {
            "stream": dataclasses.asdict(self.stream),
            "time_origin_us": TIME_ORIGIN_US - self.stream.start_us if encoding == "evt3" else 0,
        }
        text = self._store.types[TEXT](data=json.dumps(description, default=str))
        self._send(self._connect(STREAM_TOPIC, TEXT), 0, self._serialised(text, TEXT))
        wanted = {IMAGE: self.stream.frames, EXPOSURE: self.stream.frames, SAMPLE: self.stream.imu}
        info = info_message(self._store, self._header(0), self.stream, self.ROS)
        for kind, name in TOPICS.items():
            if wanted.get(kind, info is not None):
                self._others[kind] = self._connect(name, kind)
        if info is not None:
            self._send(self._others[INFO], 0, self._serialised(info, INFO))

    def _connect(self, name: str, kind: str) -> Any:
        topic = f"{self.NAMESPACE}/{name}"
        return self._writer.add_connection(topic, kind, typestore=self._store)

    def _write_packet(self, packet: EventPacket) -> None:
        events, stream = packet.events, self.stream
        first_us, last_us = int(events["t"][0]), int(events["t"][-1])
        if self._payloads is None:
            sides = stream.height, stream.width
            data: bytes | memoryview = array_bytes(
                events, self.ROS, self._packets, stream.camera, *sides
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
        """Write one image and its exposure. Errors as `write`; EvsError for undeclared frames."""
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
            self._frames += 1
        self._sync_if_due(frame.end_us)

    def write_imu(self, packet: ImuPacket) -> None:
        """Write the samples of one packet. Errors as `write`; EvsError for undeclared samples."""
        for sample in packet.samples:
            t_us = int(sample["t"])
            self._check_declared(SAMPLE, "imu", t_us)
            self._reserve(0)
            with self._library_errors():
                message = sample_message(self._store, self._header(t_us), sample)
                self._send(self._others[SAMPLE], t_us, self._serialised(message, SAMPLE))
                self._imu_samples += 1
            self._sync_if_due(t_us)

    def _check_declared(self, kind: str, key: str, t_us: int) -> None:
        self._check_open()
        if kind not in self._others:
            raise EvsError(f"{self._path} was opened without {key}: set {key} of its StreamInfo")
        if t_us < 0:
            raise EvsError(f"cannot record {key} at {t_us} us to {self._path}: .aedat4 holds them")

    def close(self) -> dict[str, Any]:
        """As LibraryRecorder's, with the numbers of frames and samples."""
        counts = {"frames": self._frames, "imu_samples": self._imu_samples}
        return super().close() | counts

    def _send(self, topic: Any, t_us: int, data: bytes | memoryview) -> None:
        self._writer.write(topic, t_us * 1000, data)

    def _header(self, t_us: int) -> Any:
        seconds, rest = divmod(t_us, 1_000_000)
        types = self._store.types
        stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest * 1000)
        sequence = {"seq": self._packets & 0xFFFFFFFF} if self.ROS == 1 else {}
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=self.stream.camera, **sequence)

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

    NAME, ROS, NAMESPACE = "rosbag1", 1, "/dvs"

    def _default_encoding(self) -> str:
        return DVS

    def _open_storage(self, path: Path) -> Storage:
        return Ros1BagFile(path)


class Ros2Recorder(_BagRecorder):
    """A rosbag2 file, MCAP or SQLite: /event_camera/events of event_camera_msgs/EventPacket.

    EVT3, as real drivers record it, or libcaer where the sensor is too large for that.
    """

    NAME, ROS, NAMESPACE = "rosbag2", 2, "/event_camera"

    def _default_encoding(self) -> str:
        limits = PAYLOADS["evt3"]
        fits = self.stream.width <= limits.width and self.stream.height <= limits.height
        return "evt3" if fits else "libcaer"

    def _open_storage(self, path: Path) -> Storage:
        if self._path.suffix.lower() == ".db3":
            return SqliteFile(path, self._path.stem)
        return McapFile(path, self._path.stem)


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
