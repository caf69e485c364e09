"""convert: copy a recording into a file of another format, in little memory."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from evs.drivers.files.capabilities import Capabilities, can_begin_with, check_stamps, one_stream
from evs.drivers.files.formats import AnyPath, Format, ReadOptions, to_read, to_write
from evs.drivers.files.metadata_file import check_metadata_replaceable, metadata_path
from evs.drivers.files.multi_file import (
    check_not_continued,
    open_recording,
    part_path,
    paths_of,
)
from evs.drivers.files.paths import target_error
from evs.drivers.files.reading import messages_of, recorder_for
from evs.drivers.files.recording_file import RecordingFile, part_us
from evs.drivers.sink import Sink, Stream
from evs.msgs import (
    IMU_DTYPE,
    EventPacket,
    Events,
    EvsError,
    Frame,
    ImuPacket,
    Labels,
    StreamInfo,
    TriggerPacket,
)

Message = EventPacket | Frame | ImuPacket | TriggerPacket

AUXILIARY = {
    "frames": "intensity frames",
    "imu": "IMU samples",
    "triggers": "triggers",
    "labels": "labels",
}
"""what a format may be unable to hold: field of Capabilities -> in words"""

_FLAGS = ("frames", "imu", "triggers")
"""fields of StreamInfo"""


@dataclass
class Converted:
    """The result of `convert`."""

    target: Path
    source_format: Format
    target_format: Format
    events: int = 0
    frames: int = 0
    imu_samples: int = 0
    triggers: int = 0
    start_us: int | None = None
    """start of the target's clock where it cannot hold the time stamps; None: they are kept"""
    left_out: dict[str, int] = field(default_factory=dict)
    """what was not written, as the target cannot hold it or evs does not read it -> how many"""
    read_as: str = ""
    """what was decided on what the source does not state; empty: nothing"""
    files: list[Path] = field(default_factory=list)
    """every file of the recording that was written; metadata (FILE.json) is not counted"""

    @property
    def size(self) -> int:
        """Bytes written."""
        return sum(path.stat().st_size for path in self.files)


def convert(
    source: AnyPath,
    target: AnyPath,
    kind: str | None = None,
    *,
    events_only: bool = False,
    reading: ReadOptions | None = None,
    keep_start: bool = False,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Converted:
    """Copy a recording into a file of another format.

    An error is raised before anything is written if the target cannot hold the recording. The
    target appears once it is complete; until then, and after an error, an earlier file of that name
    remains. If the target cannot hold the time stamps (usually Unix times), its clock begins at the
    first one. Its header states the offset, which evs adds when it reads the file. Warns of damage
    like `read`.

    Args:
        source: The recording, or the first file of one in several files.
        target: The file to write; its extension selects the format.
        kind: The format's name, if the extension does not select it.
        events_only: Omit the auxiliary streams that the target cannot hold.
        reading: Options of `read` for the source.
        keep_start: Raise an error instead of starting the target's clock at the first time stamp.
        progress: Called with the fraction of the source that has been read, 0 ... 1.
        **options: Options of the target's recorder.

    Returns:
        What was written and what was omitted.

    Raises:
        EvsError: The source cannot be read, the target cannot hold it, or it cannot be written.
    """
    found, wanted = to_read(source), to_write(target, kind)
    file = open_recording(source, found, **(reading or {}))
    target = Path(target)
    for path in paths_of(file):
        _check_place(path, target)
    if wanted.metadata_file:
        check_metadata_replaceable(target)
    limits = wanted.capabilities_for(options.get("encoding"))
    stream, missing = _target_stream(file, limits)
    if missing and not events_only:
        words = " and ".join(AUXILIARY[name] for name in missing)
        raise EvsError(
            f"{target} cannot hold the {words} of {file.path}: leave them out with --events-only, "
            "or convert to .aedat4"
        )
    format_name = wanted.display_name
    stream = one_stream(target, [stream], limits, format_name)
    result = Converted(target, found, wanted, read_as=getattr(file, "read_as", ""))
    first = next(file.events(), None)
    if first is not None:
        shifted = _with_start(first, limits, stream)
        if shifted is not stream and keep_start:
            raise EvsError(
                f"{target} cannot hold the stamps of {file.path}, from {first['t'][0]} us on: "
                "leave --start keep out, so that its clock begins there, or convert to .aedat4"
            )
        result.start_us = None if shifted is stream else shifted.start_us
        stream = shifted
        check_stamps(target, first, limits, format_name, stream)
    with _TemporaryFolder(target) as folder:
        sink = recorder_for(folder.path, kind=wanted.name, **options)
        try:
            sink.open([stream])
            labels = file.labels if limits.labels else None
            for message in _with_labels(messages_of(file), labels):
                if isinstance(message, Frame) and not limits.regions:
                    message = message.on_sensor(stream.width, stream.height)
                _write(sink, message, result)
                if progress is not None:
                    progress(file.position / max(1, file.size))
            error = sink.close().get("error")
            if error:
                raise EvsError(str(error))
        except EvsError as error:
            raise EvsError(folder.named(str(error))) from None
        finally:
            sink.close()
        result.files = folder.move_into_place(wanted)
    if file.labels is not None and "labels" in missing:
        result.left_out["labels"] = len(file.labels)
    return result


def _check_place(source: Path, target: Path) -> None:
    """EvsError where the target is the source, or cannot be a file."""
    if target.exists() and target.samefile(source):
        raise EvsError(f"{target} is the recording to be converted: give another name")
    if target.is_dir():
        raise target_error(target, IsADirectoryError())
    if not target.parent.is_dir():
        raise target_error(target, FileNotFoundError())


def _target_stream(file: RecordingFile, limits: Capabilities) -> tuple[StreamInfo, list[str]]:
    """The stream as the target can hold it, and what it cannot hold: fields of Capabilities."""
    has = {
        "frames": file.stream.frames,
        "imu": file.stream.imu,
        "triggers": file.stream.triggers,
        "labels": file.labels is not None,
    }
    missing = [name for name, on in has.items() if on and not getattr(limits, name)]
    if any(name != "labels" for name in missing):
        present = _present_streams(file, {name for name in missing if name != "labels"})
        missing = [name for name in missing if name == "labels" or name in present]
    flags: dict[str, Any] = {name: getattr(limits, name) and has[name] for name in _FLAGS}
    return replace(file.stream, **flags), missing


def _present_streams(file: RecordingFile, wanted: set[str]) -> set[str]:
    """Which of these streams a recording really has, since it may declare more."""
    found: set[str] = set()
    for message in file.auxiliary():
        if isinstance(message, Frame):
            found.add("frames")
        elif len(message):
            found.add("imu" if message.dtype == IMU_DTYPE else "triggers")
        if wanted <= found:
            break
    return found


def _with_start(first: Events, limits: Capabilities, stream: StreamInfo) -> StreamInfo:
    """The stream; it starts just before the first events if they do not fit otherwise."""
    if can_begin_with(first, limits, stream) or not limits.from_start:
        return stream
    # keep the phase of its ticks
    each_us, before_us = part_us(stream.tick_us), int(first["t"][0]) - 1
    start_us = before_us - (before_us - stream.start_us) % each_us
    scene = stream.config.get("scene")
    scene = {**(scene if isinstance(scene, dict) else {}), "start_us": start_us}
    later = replace(stream, config={**stream.config, "scene": scene})
    return later if can_begin_with(first, limits, later) else stream


def _with_labels(messages: Iterable[Message], labels: Labels | None) -> Iterator[Message]:
    """Give each event packet its part of the labels, (n,) one for each event of the recording."""
    at = 0
    for message in messages:
        if labels is None or not isinstance(message, EventPacket):
            yield message
        else:
            yield replace(message, labels=labels[at : at + len(message)])
            at += len(message)


def _write(sink: Sink, message: Message, result: Converted) -> None:
    """Write one message to the sink, or count it as left out."""
    limits = result.target_format.capabilities
    if isinstance(message, EventPacket):
        sink.write(message)
        result.events += len(message)
    elif isinstance(message, Frame):
        if Stream.FRAMES in sink.streams and limits.frames:
            sink.write_frame(message)
            result.frames += 1
        else:
            _count(result, AUXILIARY["frames"], 1)
    elif isinstance(message, ImuPacket):
        if Stream.IMU in sink.streams and limits.imu:
            sink.write_imu(message)
            result.imu_samples += len(message)
        else:
            _count(result, AUXILIARY["imu"], len(message))
    elif Stream.TRIGGERS in sink.streams and limits.triggers:
        sink.write_triggers(message)
        result.triggers += len(message)
    else:
        _count(result, AUXILIARY["triggers"], len(message))


def _count(result: Converted, what: str, count: int) -> None:
    result.left_out[what] = result.left_out.get(what, 0) + count


class _TemporaryFolder:
    """A temporary folder next to the target: a recorder may write several files."""

    def __init__(self, target: Path) -> None:
        self._target = target

    def __enter__(self) -> _TemporaryFolder:
        try:
            self._folder = Path(tempfile.mkdtemp(prefix=".evs-convert-", dir=self._target.parent))
        except OSError as reason:
            raise target_error(self._target, reason) from None
        self.path = self._folder / self._target.name
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def named(self, text: str) -> str:
        """A recorder's message with the paths that the user knows."""
        return text.replace(f"{self._folder}{os.sep}", f"{self._target.parent}{os.sep}")

    def move_into_place(self, kind: Format) -> list[Path]:
        """Move the files that were written to their places, the target itself last.

        Args:
            kind: The target's format.

        Raises:
            EvsError: Other recordings would be replaced, or read as a part of this one.
        """
        metadata = metadata_path(self.path) if kind.metadata_file else None
        made = [path for path in self._folder.iterdir() if path != metadata]
        made.sort(key=lambda path: (path == self.path, path.name))
        for path in made[:-1]:
            if (existing := self._target.parent / path.name).exists():
                raise EvsError(f"{existing} already exists: move it, or choose another name")
        after = part_path(self._target, len(made))
        if after.is_file() and getattr(kind.open(self.path), "part", None) == 0:
            check_not_continued(self._target, kind.open, len(made))
        try:
            if metadata is not None:
                metadata.replace(metadata_path(self._target))
            return sorted(path.replace(self._target.parent / path.name) for path in made)
        except OSError as reason:
            raise target_error(self._target, reason) from None
