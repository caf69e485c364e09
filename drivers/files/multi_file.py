"""MultiFileRecording: a recording that goes on in several files, as one.

Only files that our recorders wrote as its further parts belong to it: they lie beside the first,
are called after it (run-001.aedat4, run-002.aedat4, ...) without a gap, say in their headers that
they are that part of the same stream, and begin no earlier than the part before them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from evs.drivers.files.file_parts import part_path
from evs.drivers.files.formats import AnyPath, Format, to_read
from evs.drivers.files.integrity import IntegrityReport
from evs.drivers.files.recording_file import RecordingFile
from evs.msgs import Events, EvsError, Frame, ImuSamples, Labels, StreamInfo, Triggers

Message = Events | Frame | ImuSamples | Triggers


@runtime_checkable
class PartFile(Protocol):
    """A RecordingFile that knows which part of a recording it is."""

    @property
    def part(self) -> int | None:
        """From 0; None: it is no part of several."""


@dataclass
class MultiFileReport(IntegrityReport):
    """What a walk over all files met: places are those of the first that has any."""

    parts: list[tuple[Path, IntegrityReport]] = field(default_factory=list)

    def take(self, path: Path, met: IntegrityReport) -> None:
        """Add what was found in the next file."""
        self.parts.append((path, met))
        if self.torn_at is None:
            self.torn_at = met.torn_at
        self.torn_bytes += met.torn_bytes
        if met.packets and not self.packets:
            self.first, self.noun = met.first, met.noun
        self.packets += met.packets
        if met.backwards_at is not None and self.backwards_at is None:
            self.backwards_at, self.place_unit = met.backwards_at, met.place_unit
        self.unsorted += met.unsorted
        self.resets += met.resets

    def warn(self, path: Path) -> None:  # noqa: ARG002 - each warning names its own file
        """The warnings of each file."""
        for one, met in self.parts:
            met.warn(one)


@dataclass
class MultiFileRecording:
    """Several files as one RecordingFile."""

    files: list[RecordingFile]
    integrity: IntegrityReport = field(default_factory=IntegrityReport)
    left_out: dict[str, int] = field(default_factory=dict)
    position: int = 0
    labels: Labels | None = None

    @property
    def path(self) -> Path:
        """The first file's."""
        return self.files[0].path

    @property
    def paths(self) -> list[Path]:
        """Every file's."""
        return [file.path for file in self.files]

    @property
    def size(self) -> int:
        """Bytes of all."""
        return sum(file.size for file in self.files)

    @property
    def stream(self) -> StreamInfo:
        """The same for all."""
        return self.files[0].stream

    @property
    def compression(self) -> str:
        """The first file's."""
        return self.files[0].compression

    @property
    def table_packets(self) -> int | None:
        """Packets in the data tables, where every file has a whole one."""
        counts = [file.table_packets for file in self.files]
        return None if None in counts else sum(count or 0 for count in counts)

    @property
    def broken_pointer(self) -> bool:
        """Whether one of them points to a data table that is not there."""
        return any(file.broken_pointer for file in self.files)

    def events(self) -> Iterator[Events]:
        """Events of all, one file after the other."""
        for message in self._chain("events"):
            assert isinstance(message, np.ndarray)
            yield message

    def messages(self) -> Iterator[Message]:
        """All messages, one file after the other; frames are numbered through."""
        yield from self._chain("messages")

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers of all."""
        yield from self._chain("auxiliary")

    def _chain(self, what: str) -> Iterator[Message]:
        integrity, left_out = MultiFileReport(), dict[str, int]()
        done = frames = 0
        for file in self.files:
            for message in getattr(file, what)():
                self.position = done + file.position
                if isinstance(message, Frame):
                    yield replace(message, seq=frames)
                    frames += 1
                else:
                    yield message
            done += file.size
            integrity.take(file.path, file.integrity)
            for name, count in file.left_out.items():
                left_out[name] = left_out.get(name, 0) + count
        self.integrity, self.left_out = integrity, left_out


def open_recording(path: AnyPath, kind: Format | None = None) -> RecordingFile:
    """The recording that begins at a path: its only file, or all of them as one."""
    kind = kind or to_read(path)
    first = kind.open(Path(path))
    files = [first]
    if isinstance(first, PartFile) and first.part == 0:
        while (further := _next(kind, files)) is not None:
            files.append(further)
    return first if len(files) == 1 else MultiFileRecording(files)


def _next(kind: Format, files: list[RecordingFile]) -> RecordingFile | None:
    """The file that goes on where these end; None where there is none."""
    path = part_path(files[0].path, len(files))
    if not path.is_file():
        return None
    try:
        found = kind.open(path)
    except EvsError:
        # the recorder was killed in its header, or it is something else
        return None
    assert isinstance(found, PartFile)
    before, begin = _begin_us(files[-1]), _begin_us(found)
    late = before is None or begin is None or before <= begin
    same = found.part == len(files) and found.stream == files[0].stream
    return found if same and late else None


def _begin_us(file: RecordingFile) -> int | None:
    """When its first events are; None without any."""
    for events in file.events():
        return int(events["t"][0])
    return None
