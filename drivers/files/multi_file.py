"""A recording in several files: run.aedat4, run-001.aedat4, ..., read as one.

Only files that our recorders wrote as further parts of the recording belong to it: they lie in the
same folder, are named after the first (run-001.aedat4, run-002.aedat4, ...) without a gap, state in
their headers that they are that part of the same stream, and begin no earlier than the part before.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, Unpack, runtime_checkable

import numpy as np

from evs.drivers.files.formats import AnyPath, Format, ReadOptions, to_read
from evs.drivers.files.integrity import IntegrityReport
from evs.drivers.files.recording_file import RecordingFile
from evs.msgs import Events, EvsError, Frame, ImuSamples, Labels, StreamInfo, Triggers


def part_path(path: Path, number: int) -> Path:
    """The file of part `number` of a recording; part 0 has the recording's own name."""
    return path.with_name(f"{path.stem}-{number:03d}{path.suffix}") if number else path


def later_parts(path: Path) -> list[Path]:
    """The existing further parts of a recording, in their order."""
    form = re.compile(re.escape(path.stem) + r"-(\d{3,9})" + re.escape(path.suffix))
    found: list[tuple[int, Path]] = []
    try:
        siblings = list(path.parent.iterdir())
    except OSError:
        # opening the file reports what is wrong with its folder
        return []
    for file in siblings:
        match = form.fullmatch(file.name)
        if match:
            found.append((int(match[1]), file))
    return [file for _, file in sorted(found)]


def check_no_parts(path: Path) -> None:
    """Check that no parts of an earlier recording would mix with those of a new one.

    The new recording would replace some of them, and leave others that look like its own.

    Raises:
        EvsError: There are such parts.
    """
    existing = later_parts(path)
    if existing:
        others = f" and {len(existing) - 1} more" if len(existing) > 1 else ""
        raise EvsError(
            f"{existing[0]}{others} of an earlier recording would mix with this one's: "
            "move them, or choose another name"
        )


def check_not_continued(path: Path, opened: Callable[[Path], object], parts: int = 1) -> None:
    """Check that no file of an earlier recording would be read as the next part of a new one.

    Args:
        path: The new recording.
        opened: Opens a file and reads its header; its result may have an attribute `part`.
        parts: How many files the new recording has.

    Raises:
        EvsError: The next file exists, and its header states that it is the next part.
    """
    after = part_path(path, parts)
    try:
        if not after.is_file():
            return
    except OSError:
        # its name is too long for a file
        return
    try:
        part = getattr(opened(after), "part", None)
    except EvsError:
        return
    if part == parts:
        raise EvsError(
            f"{after} of an earlier recording would mix with this one's: move it, or choose "
            "another name"
        )


Message = Events | Frame | ImuSamples | Triggers


@runtime_checkable
class PartFile(Protocol):
    """A RecordingFile that knows which part of a recording it is."""

    @property
    def part(self) -> int | None:
        """Number of the part, from 0; None: the recording has one file."""


@runtime_checkable
class BeginningFile(Protocol):
    """A RecordingFile whose own reader reads the files that it goes on in."""

    def whole(self) -> RecordingFile:
        """The recording that begins with this file."""


@dataclass
class MultiFileReport(IntegrityReport):
    """What was found in all files; places are those of the first file that has any."""

    parts: list[tuple[Path, IntegrityReport]] = field(default_factory=list)

    def add(self, path: Path, report: IntegrityReport) -> None:
        """Add what was found in the next file."""
        self.parts.append((path, report))
        if self.torn_at is None:
            self.torn_at = report.torn_at
        self.torn_bytes += report.torn_bytes
        if report.packets and not self.packets:
            self.first, self.noun = report.first, report.noun
        self.packets += report.packets
        if report.backwards_at is not None and self.backwards_at is None:
            self.backwards_at, self.place_unit = report.backwards_at, report.place_unit
        self.unsorted += report.unsorted
        self.unplaced += report.unplaced
        self.resets += report.resets

    def warn(self, path: Path) -> None:  # noqa: ARG002 - each warning names its own file
        """Issue the warnings of each file."""
        for part, report in self.parts:
            report.warn(part)


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
        """The first file."""
        return self.files[0].path

    @property
    def paths(self) -> list[Path]:
        """All files."""
        return [file.path for file in self.files]

    @property
    def size(self) -> int:
        """Size of all files, bytes."""
        return sum(file.size for file in self.files)

    @property
    def stream(self) -> StreamInfo:
        """The stream, which is the same in all files."""
        return self.files[0].stream

    @property
    def streams(self) -> Mapping[str, str]:
        """The event streams of the first file."""
        return self.files[0].streams

    @property
    def read_as(self) -> str:
        """What was decided on the first file."""
        return getattr(self.files[0], "read_as", "")

    @property
    def compression(self) -> str:
        """Compression of the first file."""
        return self.files[0].compression

    @property
    def table_packets(self) -> int | None:
        """Packets in the data tables, if every file has a whole one."""
        counts = [file.table_packets for file in self.files]
        return None if None in counts else sum(count or 0 for count in counts)

    @property
    def broken_pointer(self) -> bool:
        """Whether a file points to a data table that does not exist."""
        return any(file.broken_pointer for file in self.files)

    def events(self) -> Iterator[Events]:
        """The events of all files, one file after the other."""
        for message in self._chain(lambda file: file.events()):
            assert isinstance(message, np.ndarray)
            yield message

    def messages(self) -> Iterator[Message]:
        """All messages, one file after the other; frames are renumbered."""
        yield from self._chain(lambda file: file.messages())

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers of all files."""
        yield from self._chain(lambda file: file.auxiliary())

    def _chain(self, read: Callable[[RecordingFile], Iterator[Any]]) -> Iterator[Any]:
        report, left_out = MultiFileReport(), dict[str, int]()
        done = frames = 0
        for file in self.files:
            for message in read(file):
                self.position = done + file.position
                if isinstance(message, Frame):
                    yield replace(message, seq=frames)
                    frames += 1
                else:
                    yield message
            done += file.size
            report.add(file.path, file.integrity)
            for name, count in file.left_out.items():
                left_out[name] = left_out.get(name, 0) + count
        self.integrity, self.left_out = report, left_out


def open_recording(
    path: AnyPath, kind: Format | None = None, **options: Unpack[ReadOptions]
) -> RecordingFile:
    """Open the recording that begins at a path.

    Args:
        path: The first file.
        kind: Its format; None: `formats.to_read` determines it.
        **options: What the file does not state, and `single`.

    Returns:
        The reader of its only file, or a MultiFileRecording.

    Raises:
        EvsError: The first file cannot be read.
    """
    kind = kind or to_read(path)
    single = options.get("single", False)
    first = kind.open(Path(path), **options)
    if not single and isinstance(first, BeginningFile):
        return first.whole()
    files = [first]
    if not single and isinstance(first, PartFile) and first.part == 0:
        while (further := _next_part(kind, files, options)) is not None:
            files.append(further)
    return first if len(files) == 1 else MultiFileRecording(files)


def _next_part(
    kind: Format, files: list[RecordingFile], options: ReadOptions
) -> RecordingFile | None:
    """The file that continues these files; None where there is none."""
    path = part_path(files[0].path, len(files))
    if not path.is_file():
        return None
    try:
        found = kind.open(path, **options)
    except EvsError:
        # the recorder was killed while it wrote the header, or it is another kind of file
        return None
    assert isinstance(found, PartFile)
    before, begin = _begin_us(files[-1]), _begin_us(found)
    in_order = before is None or begin is None or before <= begin
    same = found.part == len(files) and found.stream == files[0].stream
    return found if same and in_order else None


def paths_of(file: RecordingFile) -> list[Path]:
    """All files of a recording."""
    return list(getattr(file, "paths", [file.path]))


def _begin_us(file: RecordingFile) -> int | None:
    """Time of its first events, us; None without events."""
    for events in file.events():
        return int(events["t"][0])
    return None
