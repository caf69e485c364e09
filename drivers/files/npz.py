"""NPZ recordings: arrays t, x, y, p for people who have numpy and nothing else."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np

from evs.drivers.files.damage import Damage, bad_values
from evs.drivers.files.npz_beside import (
    STAMPS,
    arrays_of,
    frames_of,
    imu_of,
    in_order,
    label_arrays,
    labels_of,
    triggers_of,
)
from evs.drivers.files.recorded import by_tick, said_stream
from evs.drivers.files.recording import existing, one_stream, target_error
from evs.drivers.sink import SinkStoppedError
from evs.msgs import (
    EventPacket,
    Events,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    Labels,
    StreamInfo,
    TriggerPacket,
    Triggers,
    empty_events,
    empty_imu,
    empty_triggers,
    join_events,
    make_events,
)

COLUMNS = {"t": np.dtype("<i8"), "x": np.dtype("<i2"), "y": np.dtype("<i2"), "p": np.dtype("i1")}
"""Arrays of a recording, each (n,): t us, x and y px, p 1 ON or 0 OFF."""

STREAM = "stream"
"""Zero-dimensional string array: the StreamInfo as JSON."""

_RESERVE_BYTES = 1 << 20

_MAX_RATIO = 1100
"""Deflate expands 1032 times at most: an array that states more is damaged."""


class NpzRecorder:
    """A Sink that holds all events in memory (16 bytes each) and writes them when it is closed.

    The file appears whole or not at all. Room for it is reserved as events come, so that a full
    disk is noticed by `write`, and what came before can still be written by `close`. A killed
    process leaves nothing: record to .aedat4 where that may happen.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        self._temporary = self._path.parent / f".{self._path.name[:40]}.{os.getpid()}.{id(self)}"
        self._stream: StreamInfo | None = None
        self._parts: list[Events] = []
        self._file: IO[bytes] | None = None
        self._frames: list[Frame] = []
        self._imu: list[ImuSamples] = []
        self._triggers: list[Triggers] = []
        self._labels: list[Labels] = []
        self._beside_bytes = 0
        self._packets = 0
        self._events = 0
        self._reserved = 0
        self._failure = ""
        self._report: dict[str, Any] = {}

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Make sure of the place. EvsError: several cameras, or no place to write."""
        self._stream = one_stream(self._path, streams)
        try:
            if self._path.exists() and self._path.is_dir():
                raise IsADirectoryError
            self._file = self._temporary.open("wb")
            self._reserve(0)
        except OSError as reason:
            self._discard()
            raise target_error(self._path, reason) from None

    def write(self, packet: EventPacket) -> None:
        """Keep a copy of one packet's events. SinkStoppedError: the disk has no room for more."""
        self._check_open()
        if len(packet.events):
            labels = packet.labels
            self._make_room(len(packet.events), 0 if labels is None else labels.nbytes)
            self._parts.append(packet.events.copy())
            if labels is not None:
                self._labels.append(labels.copy())
            self._events += len(packet.events)
            self._packets += 1

    def write_frame(self, frame: Frame) -> None:
        """Keep a copy of one intensity frame; all have one size, or EvsError. Else as write."""
        first = self._frames[0].pixels if self._frames else frame.pixels
        if (frame.pixels.shape, frame.pixels.dtype) != (first.shape, first.dtype):
            raise EvsError(
                f"{self._path} holds frames of one size: {first.shape} {first.dtype}, not "
                f"{frame.pixels.shape} {frame.pixels.dtype}; record to .aedat4"
            )
        self._make_room(0, frame.pixels.nbytes + 8 * len(STAMPS))
        self._frames.append(dataclasses.replace(frame, pixels=frame.pixels.copy()))

    def write_imu(self, packet: ImuPacket) -> None:
        """Keep a copy of one packet's samples. SinkStoppedError as write."""
        self._make_room(0, packet.samples.nbytes)
        self._imu.append(packet.samples.copy())

    def write_triggers(self, packet: TriggerPacket) -> None:
        """Keep a copy of one packet's triggers. SinkStoppedError as write."""
        self._make_room(0, packet.triggers.nbytes)
        self._triggers.append(packet.triggers.copy())

    def _check_open(self) -> None:
        if self._failure:
            raise SinkStoppedError(self._failure)
        if self._file is None:
            raise EvsError(f"{self._path} is not open for recording: call open first")

    def _make_room(self, events: int, beside_bytes: int) -> None:
        """Room for more, or EvsError; what came before can still be written."""
        self._check_open()
        try:
            self._reserve(self._events + events, self._beside_bytes + beside_bytes)
        except OSError as reason:
            self._failure = (
                f"recording to {self._path} stopped after {self._events} events: "
                f"{reason.strerror}; they are kept, free some space and run again"
            )
            raise SinkStoppedError(self._failure) from None
        self._beside_bytes += beside_bytes

    def close(self) -> dict[str, Any]:
        """Write the file and let go of it. EvsError where the disk does not take it."""
        if self._file is None or self._stream is None:
            return self._report
        events = join_events(self._parts)
        self._parts = []
        said = json.dumps(dataclasses.asdict(self._stream), default=str)
        try:
            columns = {name: events[name] for name in COLUMNS}
            columns[STREAM] = np.array(said)
            columns |= arrays_of(self._frames, self._imu, self._triggers)
            columns |= label_arrays(self._labels)
            np.savez_compressed(self._file, allow_pickle=False, **columns)
            size = self._file.tell()
            self._file.truncate()
            self._file.close()
            self._temporary.replace(self._path)
        except OSError as reason:
            raise target_error(self._path, reason) from None
        finally:
            self._discard()
        self._report = {
            "type": "npz",
            "path": str(self._path),
            "packets": self._packets,
            "events": len(events),
            "frames": len(self._frames),
            "imu_samples": sum(map(len, self._imu)),
            "triggers": sum(map(len, self._triggers)),
            "bytes": size,
            "error": self._failure,
        }
        return self._report

    def _reserve(self, events: int, beside_bytes: int = 0) -> None:
        """Make the temporary file large enough for so much; OSError if the disk is not."""
        # incompressible columns grow by less than a byte an event; the rest is header and stream
        needed = _RESERVE_BYTES + 14 * events + beside_bytes + beside_bytes // 1000
        if needed > self._reserved and self._file is not None:
            grown = needed + _RESERVE_BYTES
            os.posix_fallocate(self._file.fileno(), 0, grown)
            self._reserved = grown

    def _discard(self) -> None:
        """Close and remove what is left of the temporary file, if anything is."""
        if self._file is not None:
            self._file.close()
            self._file = None
        # it may never have come about: the folder is none, the disk is read-only
        with contextlib.suppress(OSError):
            self._temporary.unlink()


@dataclass
class NpzFile:
    """One NPZ recording, ours or anybody's with integer arrays t, x, y, p of one length."""

    path: Path
    stream: StreamInfo
    compression: str
    recorded: Events
    """(n,) all of it, in memory"""
    size: int
    table_packets: int | None = None
    """an NPZ file has no data table"""
    broken_pointer: bool = False
    frames: list[Frame] = field(default_factory=list)
    imu: ImuSamples = field(default_factory=empty_imu)
    """(n,) all of them"""
    triggers: Triggers = field(default_factory=empty_triggers)
    """(n,) all of them"""
    labels: Labels | None = None
    """(n,) as the events; None: it has none"""
    left_out: dict[str, int] = field(default_factory=dict)
    """never anything"""
    position: int = 0
    """of a file that is in memory: none"""
    damage: Damage = field(default_factory=Damage)
    """never any: the archive's checksums hold, or it is not opened"""

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> NpzFile:
        """Read all of it. EvsError: no such file, damaged, other arrays than a recording's."""
        found = existing(path)
        try:
            with zipfile.ZipFile(found) as archive:
                t, x, y, p = (_array(archive, name, "iub", 1) for name in COLUMNS)
                text = _text(archive)
                names = [name.removesuffix(".npy") for name in archive.namelist()]
                get = partial(_array, archive)
                camera = _stream(text, empty_events()).camera
                frames, imu = frames_of(names, get, camera), imu_of(names, get)
                triggers = triggers_of(names, get)
                labels = labels_of(names, get, len(t))
            compressed = archive.getinfo("t.npy").compress_type != zipfile.ZIP_STORED
        except _OtherError as reason:
            raise EvsError(f"{found} is not a recording: {reason}") from None
        except Exception as reason:  # damaged bytes make zipfile and numpy raise a dozen kinds
            raise EvsError(f"cannot read {found}: {str(reason) or type(reason).__name__}") from None
        if not len(t) == len(x) == len(y) == len(p):
            raise EvsError(f"{found} is not a recording: t, x, y, p are not of one length")
        events = make_events(t, x, y, p > 0)
        stream = _stream(text, events)
        wrong = bad_values(events, stream) if len(events) else ""
        if not all(
            np.array_equal(events[name], given)
            for name, given in zip("txy", (t, x, y), strict=True)
        ):
            wrong = "a value is too large for an event"
        if wrong:
            raise EvsError(f"{found} is not a recording: {wrong}")
        # an archive of somebody else's says nothing of them
        stream = dataclasses.replace(
            stream,
            frames=stream.frames or bool(frames),
            imu=stream.imu or bool(len(imu)),
            triggers=stream.triggers or bool(len(triggers)),
        )
        return cls(
            found,
            stream,
            "deflate" if compressed else "none",
            events,
            found.stat().st_size,
            frames=frames,
            imu=imu,
            triggers=triggers,
            labels=labels,
        )

    def events(self) -> Iterator[Events]:
        """The events of each tick that has any."""
        yield from by_tick(self.recorded, self.stream.tick_us)

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """Events, frames, IMU samples and triggers of each tick, in time's order."""
        tick_us = self.stream.tick_us
        yield from in_order(self.events(), self.frames, self.imu, self.triggers, tick_us)

    def beside(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers alone."""
        yield from self.frames
        yield self.imu
        yield self.triggers


class _OtherError(Exception):
    """The archive is sound, but no recording."""


def _array(archive: zipfile.ZipFile, name: str, kinds: str, axes: int) -> np.ndarray[Any, Any]:
    """An array of an archive; nothing is allocated before its size is known to be true."""
    try:
        info = archive.getinfo(f"{name}.npy")
    except KeyError:
        raise _OtherError(f"it has no array '{name}'; it needs {', '.join(COLUMNS)}") from None
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise _OtherError(f"array '{name}' is compressed in another way than numpy does")
    if info.file_size > _MAX_RATIO * (info.compress_size + 64):
        raise _OtherError(f"array '{name}' states {info.file_size} bytes, which cannot be in it")
    with archive.open(info) as member:
        version = np.lib.format.read_magic(member)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(member)
        else:
            shape, _, dtype = np.lib.format.read_array_header_2_0(member)
        if dtype.kind not in kinds or len(shape) != axes:
            raise _OtherError(f"array '{name}' is {dtype} of shape {shape}")
        if math.prod(shape) * dtype.itemsize != info.file_size - member.tell():
            raise _OtherError(f"array '{name}' is not of the size that it states")
        return np.frombuffer(member.read(), dtype).reshape(shape)


def _text(archive: zipfile.ZipFile) -> str:
    """The stream's JSON; empty in other people's files."""
    if f"{STREAM}.npy" not in archive.namelist():
        return ""
    return str(_array(archive, STREAM, "U", 0))


def _stream(text: str, events: Events) -> StreamInfo:
    """The stream in the JSON; where it says nothing usable, what the events need."""
    try:
        said = json.loads(text) if text else {}
    except (ValueError, RecursionError):
        said = {}
    width, height = (1 + max(0, int(events[axis].max(initial=0))) for axis in "xy")
    return said_stream(said, StreamInfo(width, height, sensor="unknown"))
