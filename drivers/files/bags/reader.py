"""BagFile: the events of a ROS bag, ours or a real camera driver's."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.aedat4.compression import MAGIC, decompressed, unpacked
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.drivers.files.bags.database import journal_of, scan_database
from evs.drivers.files.bags.library import ARRAY, PACKET, TEXT, load
from evs.drivers.files.bags.messages import (
    EXPOSURE,
    IMAGE,
    SAMPLE,
    TOPICS,
    ArrayMessage,
    BadMessageError,
    deserialised,
    frame_of,
    parse_array,
    sample_of,
)
from evs.drivers.files.bags.recorder import STREAM_TOPIC
from evs.drivers.files.bags.records import (
    MCAP_MAGIC,
    ROS1_MAGIC,
    BagMessage,
    BagScan,
    ros1_file_records,
    scan_mcap,
    scan_ros1,
)
from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.formats import BAG_METADATA, PACKED_SUFFIX, is_bag_file
from evs.drivers.files.header_text import stream_from_json
from evs.drivers.files.integrity import on_sensor
from evs.drivers.files.paths import existing
from evs.drivers.files.recording_file import MultiStreamFile, choose_stream, of_stream
from evs.drivers.files.time_order import PacketSorter
from evs.msgs import (
    Events,
    EvsError,
    Frame,
    ImuSamples,
    StreamInfo,
    Triggers,
)
from evs.msgs.codecs import PAYLOADS, PayloadReader

ARRAYS = (ARRAY, "prophesee_event_msgs/msg/EventArray")
PACKETS = (PACKET, "event_array_msgs/msg/EventArray")
"""message types of one layout: the current name, and those of other or older drivers"""

KINDS = (*ARRAYS, *PACKETS)

MAX_SAMPLES_TOGETHER = 1000
"""most IMU samples in one message"""

_PIECE_BYTES = 1 << 20
"""bytes of a stream that are decoded at once"""

Message = Events | Frame | ImuSamples | Triggers


@dataclass
class BagFile(MultiStreamFile):
    """A ROS bag, opened with `BagFile.at(path)`; it yields packets as they were recorded."""

    ros: int = 2
    topic: str = ""
    """topic of the events"""
    paths: list[Path] = field(default_factory=list)
    """its files, in their order"""
    scanned: list[Path] = field(default_factory=list)
    """the same, those that are compressed as a whole decompressed"""
    unpacked: list[UnpackedFile] = field(default_factory=list)
    time_origin_us: int = 0

    @classmethod
    def at(cls, path: str | os.PathLike[str], stream: str | int | None = None) -> BagFile:
        """Read up to the first packet.

        Args:
            path: A file, or the folder of a ROS 2 bag.
            stream: Topic of the events; None: the first.

        Raises:
            EvsError: No such file, rosbags is not installed, damaged, no events of a type that we
                know, or no such topic.
        """
        return cls._of(Path(path), files_of(Path(path)), stream)

    def whole(self) -> BagFile:
        """The bag that begins with this file, where its folder says that it goes on in others."""
        if self.path.is_dir() or self.ros == 1:
            return self
        paths = whole(self.path)
        return self._of(self.path, paths, self.topic) if len(paths) > 1 else self

    @classmethod
    def _of(cls, found: Path, paths: list[Path], wanted: str | int | None) -> BagFile:
        load()
        ros = 1 if found.suffix.lower() == ".bag" else 2
        size = sum(one.stat().st_size for one in paths)
        opened = cls(found, StreamInfo(0, 0), size, ros=ros, paths=paths)
        for one in paths:
            if one.name.endswith(PACKED_SUFFIX):
                opened.unpacked.append(UnpackedFile(one))
                opened.scanned.append(opened.unpacked[-1].path)
            else:
                opened.scanned.append(one)
        try:
            opened.unfinished = any(map(opened._is_unfinished, opened.scanned))
            opened._probe(wanted)
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror or reason}") from None
        except CorruptDataError as reason:
            raise EvsError(f"{found} is not a readable bag: {reason}") from None
        return opened

    def _iterate(self, events: bool, auxiliary: bool) -> Iterator[Message]:
        """The requested messages; events and triggers are sorted."""
        left_out: dict[str, int] = {}
        readers: dict[str, PayloadReader] = {}
        auxiliary_parser = _AuxiliaryParser(
            self.topic.rpartition("/")[0], self.stream.camera, self.ros
        )
        scan = BagScan()
        sorter = PacketSorter(scan.integrity)
        for found in self._bag_messages(scan):
            try:
                if found.kind in KINDS and (events or self.stream.triggers):
                    marks: list[Triggers] = []
                    for sample in auxiliary_parser.flush():
                        yield from sorter.add(sample)
                    for part in self._events_of(found, scan, readers, left_out, marks):
                        if auxiliary and marks:
                            merged = np.concatenate(marks)
                            yield from sorter.add(merged[np.argsort(merged["t"], kind="stable")])
                        marks.clear()
                        if events and len(part):
                            yield from sorter.feed(part, found.at)
                elif auxiliary and not self._is_others(found, scan, left_out):
                    for message in auxiliary_parser.parse(found, left_out):
                        yield from sorter.add(message)
            except BadMessageError as reason:
                scan.integrity.corrupt(found.at, str(reason))
        yield from sorter.flush()
        yield from auxiliary_parser.flush()
        self.streams = choose_stream(self.path, _event_topics(scan.kinds), self.topic)
        skipped = sum(reader.skipped for reader in readers.values())
        if skipped:
            left_out["events before the first time stamp"] = skipped
        self.integrity, self.left_out = scan.integrity, left_out

    def _events_of(
        self,
        found: BagMessage,
        scan: BagScan,
        readers: dict[str, PayloadReader],
        left_out: dict[str, int],
        triggers: list[Triggers],
    ) -> Iterator[Events]:
        """The events of one message of our topic, as recorded; its triggers go to `triggers`."""
        if found.topic != self.topic:
            _count(left_out, of_stream("messages with events", found.topic, ""))
            return
        for part in self._decoded(self._parse(found), readers, left_out, triggers):
            events, outside = on_sensor(part, self.stream.width, self.stream.height)
            if outside:
                scan.integrity.corrupt(found.at, "events lie outside of the sensor", outside)
            yield events

    def _is_others(self, found: BagMessage, scan: BagScan, left_out: dict[str, int]) -> bool:
        """Whether a frame or an IMU sample is of another event camera; it is counted then."""
        namespace = found.topic.rpartition("/")[0]
        if found.kind not in _UNREAD or namespace == self.topic.rpartition("/")[0]:
            return False
        for topic in _event_topics(scan.kinds):
            if topic.rpartition("/")[0] == namespace:
                _count(left_out, of_stream(_UNREAD[found.kind], topic, ""))
                return True
        return False

    def _is_unfinished(self, path: Path) -> bool:
        """Whether the end of an MCAP file or the index is missing, or a transaction was cut off."""
        if path.suffix.lower() == ".db3":
            return journal_of(path) is not None
        size = path.stat().st_size
        with path.open("rb") as file:
            if self.ros == 2:
                file.seek(max(0, size - len(MCAP_MAGIC)))
                return file.read() != MCAP_MAGIC
            file.seek(len(ROS1_MAGIC))
            first = next(ros1_file_records(file, size), None)
        return first is None or not any(first.fields.get(b"index_pos", b""))

    def _probe(self, wanted: str | int | None) -> None:
        """Find the first events, of this topic if one is wanted, and their stream."""
        stated: dict[str, dict[str, Any]] = {}
        first: Any = None
        scan = BagScan()
        for found in self._bag_messages(scan):
            if found.kind == TEXT and found.topic.endswith(f"/{STREAM_TOPIC}"):
                stated[found.topic] = self._stream_description(found)
            elif found.kind in KINDS and str(wanted or found.topic).lower() == found.topic.lower():
                with suppress(BadMessageError):
                    first = self._parse(found)
                    self.topic = found.topic
                    break
        if first is None:
            # recorded, but nothing was seen
            self.topic = next(iter(choose_stream(self.path, _event_topics(scan.kinds), wanted)), "")
        if not self.topic:
            kinds = ", ".join(sorted(set(scan.kinds.values())))[:200] or "nothing"
            kinds = "".join(letter if letter.isprintable() else "?" for letter in kinds)
            raise EvsError(f"{self.path} holds no events but {kinds}")
        width, height = (1, 1) if first is None else (first.width, first.height)
        if not 0 < min(width, height) <= max(width, height) <= MAX_SIDE_PX:
            raise EvsError(f"{self.path} is damaged: its sensor is of {width} x {height} px")
        plain = StreamInfo(int(width), int(height), sensor="unknown")
        name = getattr(first, "frame_id", "") or ""
        if name.isprintable() and 0 < len(name.encode()) < 256:
            plain = dataclasses.replace(plain, camera=name)
        ours = stated.get(self.topic.rpartition("/")[0] + "/" + STREAM_TOPIC, {})
        there = _declared_auxiliary(scan.kinds, self.topic.rpartition("/")[0])
        stream = stream_from_json(ours.get("stream"), plain)
        self.stream = dataclasses.replace(stream, **there, triggers=False)
        origin = ours.get("time_origin_us", 0)
        self.time_origin_us = origin if isinstance(origin, int) and abs(origin) < 1 << 53 else 0
        # ours hold none
        codec = PAYLOADS.get(getattr(first, "encoding", ""))
        if not ours and codec is not None and codec.has_clock:
            self.stream = dataclasses.replace(self.stream, triggers=self._has_triggers())

    def _has_triggers(self) -> bool:
        """Whether any packet holds an external trigger; reads up to the first one."""
        readers: dict[str, PayloadReader] = {}
        marks: list[Triggers] = []
        for found in self._bag_messages(BagScan()):
            if found.kind in PACKETS and found.topic == self.topic:
                with suppress(BadMessageError):
                    for _ in self._decoded(self._parse(found), readers, {}, marks):
                        if marks:
                            return True
        return False

    def _bag_messages(self, scan: BagScan) -> Iterator[BagMessage]:
        """Every message of the bag, those that were compressed one by one decompressed."""
        done = 0
        for path in self.scanned:
            if path.suffix.lower() == ".db3":
                messages = scan_database(path, scan)
            else:
                messages = (scan_ros1 if self.ros == 1 else scan_mcap)(path, scan)
            for found in messages:
                self.position = min(done + found.at, self.size)
                # a message of ROS 2 begins with the number of its encoding, 0 or 1
                if self.ros == 2 and found.data.startswith(MAGIC["zstd"]):
                    try:
                        found = dataclasses.replace(found, data=unpacked(found.data, "zstd"))
                    except CorruptDataError as reason:
                        scan.integrity.corrupt(found.at, str(reason))
                        continue
                yield found
            done += path.stat().st_size

    def _stream_description(self, found: BagMessage) -> dict[str, Any]:
        """The description that our recorder wrote, empty if it cannot be read."""
        with suppress(Exception):
            stated = json.loads(deserialised(found.data, TEXT, self.ros).data)
            return stated if isinstance(stated, dict) else {}
        return {}

    def _parse(self, found: BagMessage) -> Any:
        """Decode an ArrayMessage or an EventPacket; BadMessageError where the bytes are neither."""
        if found.kind in ARRAYS:
            return parse_array(found.data, self.ros)
        message = deserialised(found.data, PACKET, self.ros)
        message.frame_id = message.header.frame_id
        return message

    def _decoded(
        self,
        message: Any,
        readers: dict[str, PayloadReader],
        left_out: dict[str, int],
        triggers: list[Triggers],
    ) -> Iterator[Events]:
        """The events of one message in the order recorded; those of long ones in parts."""
        if isinstance(message, ArrayMessage):
            yield message.events
            return
        name = message.encoding
        if name not in PAYLOADS:
            _count(left_out, f"packets of encoding {name[:20]!r}")
            return
        if name not in readers:
            readers[name] = PayloadReader(name, time_origin_us=self.time_origin_us)
        data = np.ascontiguousarray(message.events)
        codec = PAYLOADS[name]
        if len(data) > codec.most_bytes:
            raise BadMessageError(f"a packet of {name} has {len(data)} bytes")
        each = _PIECE_BYTES if codec.has_clock else max(1, len(data))
        for begin in range(0, len(data), each):
            piece = data[begin : begin + each]
            yield readers[name].events(piece, int(message.time_base), triggers)


_UNREAD = {IMAGE: "frames", SAMPLE: "IMU samples"}
"""type of a message of a camera that is not read -> what is counted of it"""


def _event_topics(kinds: dict[str, str]) -> dict[str, str]:
    """The topics with events, as event streams."""
    return {topic: "" for topic, kind in kinds.items() if kind in KINDS}


def _declared_auxiliary(kinds: dict[str, str], namespace: str) -> dict[str, Any]:
    """Field of StreamInfo -> whether the camera's namespace has such a topic."""
    wanted = {"frames": IMAGE, "imu": SAMPLE}
    return {key: kinds.get(f"{namespace}/{TOPICS[kind]}") == kind for key, kind in wanted.items()}


def _count(left_out: dict[str, int], what: str) -> None:
    """Count one more message that is not read."""
    left_out[what] = left_out.get(what, 0) + 1


class _AuxiliaryParser:
    """Parses a camera's messages into frames and groups of consecutive IMU samples."""

    def __init__(self, namespace: str, camera: str, ros: int) -> None:
        self._topics = {f"{namespace}/{name}": kind for kind, name in TOPICS.items()}
        self._camera, self._ros = camera, ros
        self._exposure_us = 0
        self._frames = 0
        self._samples: list[ImuSamples] = []

    def parse(self, found: BagMessage, left_out: dict[str, int]) -> Iterator[Frame | ImuSamples]:
        """Parse a message of the camera. BadMessageError: it is not of its type."""
        if self._topics.get(found.topic) != found.kind:
            return
        if found.kind == EXPOSURE:
            self._exposure_us = max(0, int(deserialised(found.data, EXPOSURE, self._ros).data))
        elif found.kind == SAMPLE:
            self._samples.append(sample_of(deserialised(found.data, SAMPLE, self._ros)))
            if len(self._samples) >= MAX_SAMPLES_TOGETHER:
                yield from self.flush()
        elif found.kind == IMAGE:
            message = deserialised(found.data, IMAGE, self._ros)
            frame = frame_of(message, self._frames, self._camera, self._exposure_us)
            if frame is None:
                _count(left_out, "frames that are not grey")
                return
            yield from self.flush()
            yield frame
            self._frames += 1

    def flush(self) -> Iterator[ImuSamples]:
        """The samples since the last other message."""
        if self._samples:
            yield np.concatenate(self._samples)
            self._samples = []


_LISTED = re.compile(r"^[ \t]*relative_file_paths:[ \t]*\n((?:[ \t]*-[^\n]*\n?)+)", re.MULTILINE)
_NUMBER = re.compile(r"_(\d{1,9})\.")
_MAX_METADATA_BYTES = 1 << 24


def files_of(path: Path) -> list[Path]:
    """The files of a bag in their order.

    Args:
        path: A file, or the folder of a bag: metadata.yaml lists its files; without it (the
            recorder was killed), they are those with the endings of bags, by their numbers.

    Raises:
        EvsError: There is no such file, or a file that is listed is missing.
    """
    if not path.is_dir():
        return [existing(path)]
    listed = _listed(path)
    found = listed or [one for one in path.iterdir() if is_bag_file(one)]
    return [existing(one) for one in (found if listed else sorted(found, key=_order))]


def whole(path: Path) -> list[Path]:
    """The files of the bag that begins with this file; only the file if it is not the first."""
    listed = _listed(path.parent)
    begins = bool(listed) and listed[0].name == path.name
    return [existing(one) for one in listed] if begins else [path]


def _listed(folder: Path) -> list[Path]:
    """The files that the metadata of a bag's folder list; none without metadata."""
    try:
        with (folder / BAG_METADATA).open("rb") as file:
            text = file.read(_MAX_METADATA_BYTES).decode(errors="replace")
    except OSError:
        return []
    match = _LISTED.search(text)
    names = (
        [line.strip().lstrip("-").strip(" '\"") for line in match[1].splitlines()] if match else []
    )
    # a path leads nowhere else
    return [folder / Path(name).name for name in names if name]


def _order(path: Path) -> tuple[int, str]:
    number = _NUMBER.search(path.name)
    return (int(number[1]) if number else 0, path.name)


class UnpackedFile:
    """A file that was compressed as a whole, decompressed as long as this object lives."""

    def __init__(self, packed: Path) -> None:
        """Decompress a file. EvsError: it is damaged, or there is no space for it."""
        folder = tempfile.mkdtemp(prefix="evs-bag-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.path = Path(folder) / packed.name[: -len(PACKED_SUFFIX)]
        try:
            with packed.open("rb") as source, self.path.open("wb") as target:
                for part in decompressed(source):
                    target.write(part)
        except CorruptDataError as reason:
            raise EvsError(f"{packed} is damaged: {reason}") from None
        except OSError as reason:
            raise EvsError(
                f"cannot decompress {packed} in {folder}: {reason.strerror}; set TMPDIR to a place "
                "with space, or decompress it with zstd -d"
            ) from None
