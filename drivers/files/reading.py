"""Recordings of any format: read, stream, repair, record."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from evs.drivers.files.formats import AnyPath, to_read, to_write
from evs.drivers.files.recorded import RecordedFile
from evs.drivers.files.recording import Beside, Recording, as_packet
from evs.drivers.files.repaired import Repair, cut
from evs.drivers.files.series import SeriesFile, opened_series
from evs.drivers.sink import Sink
from evs.msgs import (
    IMU_DTYPE,
    TRIGGER_DTYPE,
    EventPacket,
    Events,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    StreamInfo,
    TriggerPacket,
    Triggers,
    empty_events,
)


class LeftOutWarning(UserWarning):
    """A recording holds sound data that we do not read, such as frames in colour."""


def read(path: AnyPath, *, single: bool = False) -> Recording:
    """All events of a recording, with `.stream`, `.frames`, `.imu`, `.triggers` for the rest.

    In: single, only this file, where the recording goes on in further ones (series.py).

    A torn tail or damaged packets are left out, with a TornTailWarning or DamagedPacketWarning.
    EvsError: no such file, unknown ending, not a recording.
    """
    file = opened(path, single=single)
    events = _joined(file.events())
    file.damage.warn(file.path)
    return Recording.of(events, file.stream, Beside(lambda: _beside(path, single), file.labels))


_GROWTH = 8
"""What all events are collected in grows by a part in so many, in place where it is large."""


def _joined(parts: Iterator[Events]) -> Events:
    """The parts one after the other; nothing but the last part is there twice."""
    joined, end = empty_events(0), 0
    for part in parts:
        until = end + len(part)
        if until > len(joined):
            joined.resize(until + until // _GROWTH, refcheck=False)
        joined[end:until] = part
        end = until
    joined.resize(end, refcheck=False)
    return joined


def packets(path: AnyPath, *, single: bool = False) -> Iterator[EventPacket]:
    """The recording's packets one by one, numbered from 0; their events are read-only.

    Ticks without events were not recorded and do not come back. In and warnings: as read.
    """
    file = opened(path, single=single)
    for seq, events in enumerate(file.events()):
        yield as_packet(seq, events, file.stream)
    file.damage.warn(file.path)


def messages(
    path: AnyPath, *, single: bool = False
) -> Iterator[EventPacket | Frame | ImuPacket | TriggerPacket]:
    """Everything recorded, message by message, in the order recorded. In, warnings: as read."""
    yield from messages_of(opened(path, single=single))


def messages_of(file: RecordedFile) -> Iterator[EventPacket | Frame | ImuPacket | TriggerPacket]:
    """The messages of an opened recording, in the order recorded. Warns like read, at the end."""
    events = imu = triggers = 0
    for message in file.messages():
        if isinstance(message, Frame):
            yield message
        elif message.dtype == IMU_DTYPE:
            yield ImuPacket(imu, message, file.stream.camera)
            imu += 1
        elif message.dtype == TRIGGER_DTYPE:
            yield TriggerPacket(triggers, message, file.stream.camera)
            triggers += 1
        else:
            yield as_packet(events, message, file.stream)
            events += 1
    _warn(file)


def _beside(path: AnyPath, single: bool) -> Iterator[Frame | ImuSamples | Triggers]:
    """What lies beside the events; where damage was met, reading those warned of it."""
    file = opened(path, single=single)
    if file.stream.frames or file.stream.imu or file.stream.triggers:
        yield from file.beside()
        _warn_left_out(file)


def _warn(file: RecordedFile) -> None:
    file.damage.warn(file.path)
    _warn_left_out(file)


def _warn_left_out(file: RecordedFile) -> None:
    for what, count in file.left_out.items():
        text = f"{file.path}: {count} {what} were left out"
        warnings.warn(text, LeftOutWarning, stacklevel=3)


def stream_of(path: AnyPath) -> StreamInfo:
    """What a recording says of its stream: resolution, camera, seed, configuration, ..."""
    return opened(path, single=True).stream


def repair(path: AnyPath) -> Repair:
    """Cut a torn tail in place; all that is whole stays. An .npz file is whole or not readable."""
    kind = to_read(path)
    return cut(kind.open(Path(path))) if kind.repair is None else kind.repair(Path(path))


def recorder_for(
    path: AnyPath, compression: str | None = None, *, kind: str | None = None, **options: Any
) -> Sink:
    """The recorder for a file name, not yet open; `kind` names one where the ending does not.

    In: compression, lz4, none or zstd for the formats that have it; options, others of the format.
    EvsError: an option that it has not.
    """
    chosen = to_write(path, kind)
    if compression is not None and "compression" in chosen.keys:
        options["compression"] = compression
    for key in options:
        if key not in chosen.keys:
            has = ", ".join(chosen.keys) or "none"
            raise EvsError(f"{chosen.called} has no option {key}; it has: {has}")
    return chosen.record(Path(path), **options)


def opened(path: AnyPath, *, single: bool = False) -> RecordedFile:
    """The recording at a path, its header read. In: single, as read."""
    return to_read(path).open(Path(path)) if single else opened_series(path)


def parts(path: AnyPath) -> list[Path]:
    """The files of the recording that begins at a path."""
    file = opened(path)
    return file.paths if isinstance(file, SeriesFile) else [file.path]
