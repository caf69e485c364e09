"""convert: a recording of one format into a file of another, in little memory."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from evs.drivers.files.capabilities import Capabilities, can_begin_with, check_stamps, one_stream
from evs.drivers.files.file_parts import check_not_continued, part_path
from evs.drivers.files.formats import AnyPath, Format, to_read, to_write
from evs.drivers.files.multi_file import MultiFileRecording, open_recording
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
"""What a format may not hold: field of Holds -> in words."""

_FLAGS = ("frames", "imu", "triggers")
"""of StreamInfo"""


@dataclass
class Converted:
    """What convert did."""

    target: Path
    source_format: Format
    target_format: Format
    events: int = 0
    frames: int = 0
    imu_samples: int = 0
    triggers: int = 0
    start_us: int | None = None
    """what the target's clock begins at, since it cannot hold the stamps; None: they are kept"""
    left_out: dict[str, int] = field(default_factory=dict)
    """what was not written, since the target cannot hold it or we do not read it -> how many"""
    files: list[Path] = field(default_factory=list)
    """every file that was written"""

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
    single: bool = False,
    keep_start: bool = False,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Converted:
    """Write all of `source` anew as `target`, whose ending (or `kind`) says the format.

    In: events_only, leave out what lies beside the events where the target cannot hold it;
    single, only this file, where the recording goes on in further ones; keep_start, refuse where
    the target's clock would have to begin at the first stamp; progress, called with the share of
    the source that is read; options of the target's recorder.

    Where the target cannot hold the stamps, of Unix time above all, its clock begins at the first
    one; its header says so, and our reader adds it.

    What the target cannot hold is refused before anything is written. The target appears once it is
    complete: an earlier file of that name stays until then, and for good where an error ends it.
    Warns of damage as read does.
    """
    found, wanted = to_read(source), to_write(target, kind)
    file = found.open(Path(source)) if single else open_recording(source, found)
    target = Path(target)
    for path in file.paths if isinstance(file, MultiFileRecording) else [file.path]:
        _check_place(path, target)
    limits = wanted.capabilities_for(options.get("encoding"))
    stream, lacking = _fitting(file, limits)
    if lacking and not events_only:
        words = " and ".join(AUXILIARY[name] for name in lacking)
        raise EvsError(
            f"{target} cannot hold the {words} of {file.path}: leave them out with --events-only, "
            "or convert to .aedat4"
        )
    format_name = wanted.display_name
    stream = one_stream(target, [stream], limits, format_name)
    done = Converted(target, found, wanted)
    first = next(file.events(), None)
    if first is not None:
        shifted = _begun(first, limits, stream)
        if shifted is not stream and keep_start:
            raise EvsError(
                f"{target} cannot hold the stamps of {file.path}, from {first['t'][0]} us on: "
                "leave --start keep out, so that its clock begins there, or convert to .aedat4"
            )
        done.start_us = None if shifted is stream else shifted.start_us
        stream = shifted
        check_stamps(target, first, limits, format_name, stream)
    with _Place(target) as place:
        sink = recorder_for(place.path, kind=wanted.name, **options)
        try:
            sink.open([stream])
            labels = file.labels if limits.labels else None
            for message in _labelled(messages_of(file), labels):
                _put(sink, message, done)
                if progress is not None:
                    progress(file.position / max(1, file.size))
            error = sink.close().get("error")
            if error:
                raise EvsError(str(error))
        except EvsError as error:
            raise EvsError(place.named(str(error))) from None
        finally:
            sink.close()
        done.files = place.settle(wanted)
    if file.labels is not None and "labels" in lacking:
        done.left_out["labels"] = len(file.labels)
    return done


def _check_place(source: Path, target: Path) -> None:
    """EvsError where the target is the source, or can be no file."""
    if target.exists() and target.samefile(source):
        raise EvsError(f"{target} is what would be converted: give another name")
    if target.is_dir():
        raise target_error(target, IsADirectoryError())
    if not target.parent.is_dir():
        raise target_error(target, FileNotFoundError())


def _fitting(file: RecordingFile, limits: Capabilities) -> tuple[StreamInfo, list[str]]:
    """The stream as the target can hold it, and what it cannot: fields of Holds."""
    has = {
        "frames": file.stream.frames,
        "imu": file.stream.imu,
        "triggers": file.stream.triggers,
        "labels": file.labels is not None,
    }
    lacking = [name for name, said in has.items() if said and not getattr(limits, name)]
    if any(name != "labels" for name in lacking):
        there = _or_none(file, {name for name in lacking if name != "labels"})
        lacking = [name for name in lacking if name == "labels" or name in there]
    flags: dict[str, Any] = {name: getattr(limits, name) and has[name] for name in _FLAGS}
    return replace(file.stream, **flags), lacking


def _or_none(file: RecordingFile, wanted: set[str]) -> set[str]:
    """Which of some fields of Holds a recording has, since it may declare more than that."""
    found: set[str] = set()
    for message in file.auxiliary():
        if isinstance(message, Frame):
            found.add("frames")
        elif len(message):
            found.add("imu" if message.dtype == IMU_DTYPE else "triggers")
        if wanted <= found:
            break
    return found


def _begun(first: Events, limits: Capabilities, stream: StreamInfo) -> StreamInfo:
    """The stream, with its begin just before the first events where else they do not fit."""
    if can_begin_with(first, limits, stream) or not limits.from_start:
        return stream
    # where its ticks begin stays
    each_us, before_us = part_us(stream.tick_us), int(first["t"][0]) - 1
    start_us = before_us - (before_us - stream.start_us) % each_us
    scene = stream.config.get("scene")
    scene = {**(scene if isinstance(scene, dict) else {}), "start_us": start_us}
    later = replace(stream, config={**stream.config, "scene": scene})
    return later if can_begin_with(first, limits, later) else stream


def _labelled(stored: Iterable[Message], labels: Labels | None) -> Iterator[Message]:
    """The messages; packets with their part of the labels, (n,) as all events."""
    at = 0
    for message in stored:
        if labels is None or not isinstance(message, EventPacket):
            yield message
        else:
            yield replace(message, labels=labels[at : at + len(message)])
            at += len(message)


def _put(sink: Sink, message: Message, done: Converted) -> None:
    """One message into the sink, if it takes it."""
    limits = done.target_format.capabilities
    if isinstance(message, EventPacket):
        sink.write(message)
        done.events += len(message)
    elif isinstance(message, Frame):
        if Stream.FRAMES in sink.streams and limits.frames:
            sink.write_frame(message)
            done.frames += 1
        else:
            _count(done, AUXILIARY["frames"], 1)
    elif isinstance(message, ImuPacket):
        if Stream.IMU in sink.streams and limits.imu:
            sink.write_imu(message)
            done.imu_samples += len(message)
        else:
            _count(done, AUXILIARY["imu"], len(message))
    elif Stream.TRIGGERS in sink.streams and limits.triggers:
        sink.write_triggers(message)
        done.triggers += len(message)
    else:
        _count(done, AUXILIARY["triggers"], len(message))


def _count(done: Converted, what: str, count: int) -> None:
    done.left_out[what] = done.left_out.get(what, 0) + count


class _Place:
    """A folder beside the target in which it comes about, since a recorder may write many files."""

    def __init__(self, target: Path) -> None:
        self._target = target

    def __enter__(self) -> _Place:
        try:
            self._folder = Path(tempfile.mkdtemp(prefix=".evs-convert-", dir=self._target.parent))
        except OSError as reason:
            raise target_error(self._target, reason) from None
        self.path = self._folder / self._target.name
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def named(self, text: str) -> str:
        """A recorder's words, with the names that the user knows."""
        return text.replace(f"{self._folder}{os.sep}", f"{self._target.parent}{os.sep}")

    def settle(self, kind: Format) -> list[Path]:
        """Move what was written to where it belongs; the target itself last.

        In: its format. EvsError where other recordings would be replaced, or taken for a part.
        """
        made = sorted(self._folder.iterdir(), key=lambda path: (path == self.path, path.name))
        for path in made[:-1]:
            if (there := self._target.parent / path.name).exists():
                raise EvsError(f"{there} is there already: move it, or choose another name")
        after = part_path(self._target, len(made))
        if after.is_file() and getattr(kind.open(self.path), "part", None) == 0:
            check_not_continued(self._target, kind.open, len(made))
        try:
            return sorted(path.replace(self._target.parent / path.name) for path in made)
        except OSError as reason:
            raise target_error(self._target, reason) from None
