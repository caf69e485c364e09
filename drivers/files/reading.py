"""Recordings of any format: read them at once or message by message, repair them, record."""

from __future__ import annotations

import html
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from evs.drivers.files.formats import AnyPath, ReadOptions, to_read, to_write
from evs.drivers.files.integrity import Repair
from evs.drivers.files.multi_file import open_recording, paths_of
from evs.drivers.files.paths import target_error
from evs.drivers.files.recording_file import OF_STREAM, RecordingFile
from evs.drivers.files.time_order import sort_events
from evs.drivers.sink import Sink
from evs.msgs import (
    EVENT_DTYPE,
    IMU_DTYPE,
    TRIGGER_DTYPE,
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
    make_events,
)
from evs.msgs.pictures import event_facts, event_frame, html_card
from evs.msgs.registry import load

SHOWN_US, RATE_INTERVALS = 20_000, 100
SHOWN_SIDE_PX = 4096
"""of a recording in a notebook: the time of the events in the picture, the points of the curve, the
longest side of the picture"""


class AuxiliaryData:
    """The frames, IMU samples and triggers of a recording, read when first used."""

    def __init__(
        self,
        load: Callable[[], Iterable[Frame | ImuSamples | Triggers]],
        labels: Labels | None = None,
    ) -> None:
        """Keep how to read them.

        Args:
            load: Reads all frames, IMU samples and triggers.
            labels: (n,) labels of all events; None: the recording has none.
        """
        self._load, self.labels = load, labels

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """All frames, in the order recorded."""
        return tuple(one for one in self._all if isinstance(one, Frame))

    @cached_property
    def imu(self) -> ImuSamples:
        """(n,) IMU_DTYPE, all samples."""
        return np.concatenate([empty_imu(), *self._of(IMU_DTYPE)])

    @cached_property
    def triggers(self) -> Triggers:
        """(n,) TRIGGER_DTYPE, all triggers."""
        return np.concatenate([empty_triggers(), *self._of(TRIGGER_DTYPE)])

    def _of(self, dtype: np.dtype[Any]) -> list[ImuSamples | Triggers]:
        return [one for one in self._all if not isinstance(one, Frame) and one.dtype == dtype]

    @cached_property
    def _all(self) -> list[Frame | ImuSamples | Triggers]:
        return list(self._load())


class Recording(np.ndarray[Any, np.dtype[np.void]]):
    """The events of a recording, (n,) EVENT_DTYPE in the order recorded, with their stream.

    It is an ordinary structured array. Slices, masks and copies keep `.stream`, `.frames`, `.imu`
    and `.triggers`; its columns (`recording["t"]`) are plain NumPy arrays that share its memory.
    """

    stream: StreamInfo
    _auxiliary: AuxiliaryData

    @classmethod
    def of(
        cls, events: Events, stream: StreamInfo, auxiliary: AuxiliaryData | None = None
    ) -> Recording:
        """A Recording that shares the memory of the events, (n,) EVENT_DTYPE."""
        recording = np.asarray(events, EVENT_DTYPE).view(cls)
        recording.stream = stream
        recording._auxiliary = auxiliary or AuxiliaryData(tuple)
        return recording

    def __array_finalize__(self, parent: Any) -> None:
        for name in ("stream", "_auxiliary"):
            value = getattr(parent, name, None)
            if value is not None:
                setattr(self, name, value)

    def __getitem__(self, key: Any) -> Any:
        found = super().__getitem__(key)
        # of a column, mean() and the like are plain numbers
        is_column = isinstance(found, Recording) and found.dtype != EVENT_DTYPE
        return found.view(np.ndarray) if is_column else found

    def _repr_html_(self) -> str:
        if self.dtype != EVENT_DTYPE or self.ndim != 1:
            return f"<pre>{html.escape(repr(self))}</pre>"
        stream = self.stream
        facts = {
            "sensor": stream.sensor,
            "size": f"{stream.width} x {stream.height} px",
            **event_facts(self),
        }
        # the events around the middle one; a slice need not be in order
        middle_us = int(self["t"][len(self) // 2]) if len(self) else 0
        shown = np.abs(self["t"] - middle_us) <= SHOWN_US // 2
        facts["picture"] = f"{SHOWN_US // 1000} ms around {middle_us:,} us"
        events = np.asarray(self[shown])
        each_px = 1 + (max(stream.width, stream.height) - 1) // SHOWN_SIDE_PX
        if each_px > 1:
            events = make_events(
                *(
                    events[name] // by
                    for name, by in zip("txyp", (1, each_px, each_px, 1), strict=True)
                )
            )
            facts["picture"] += f", a pixel for {each_px} x {each_px}"
        picture = event_frame(events, -(-stream.width // each_px), -(-stream.height // each_px))
        sorted_times = len(self) and bool((np.diff(self["t"]) >= 0).all())
        rates = (np.asarray(self), RATE_INTERVALS) if sorted_times else None
        return html_card(f"Recording of {stream.camera}", facts, picture, rates)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """All intensity frames of the recording, whichever events are selected."""
        return self._auxiliary.frames

    @property
    def imu(self) -> ImuSamples:
        """(n,) IMU_DTYPE, all samples: t, acceleration, angular_velocity, temperature."""
        return self._auxiliary.imu

    @property
    def triggers(self) -> Triggers:
        """(n,) TRIGGER_DTYPE, all triggers: t, kind (a Trigger)."""
        return self._auxiliary.triggers

    @property
    def labels(self) -> Labels | None:
        """(n,) LABEL_DTYPE, cause and geom_id of all its events; None: it has none."""
        return self._auxiliary.labels


def as_packet(seq: int, events: Events, stream: StreamInfo) -> EventPacket:
    """Make a packet of events that were recorded together.

    Args:
        seq: Number of the packet.
        events: (n,) EVENT_DTYPE with n > 0, sorted by t.
        stream: Their stream.

    Returns:
        The packet. Its interval is made of the ticks that the events lie in: tick k is
        (t_{k-1}, t_k].
    """
    first, last, tick_us = int(events["t"][0]), int(events["t"][-1]), stream.tick_us
    # ticks are counted from the start of the stream
    start_us = stream.start_us
    return EventPacket(
        seq=seq,
        time_base_us=start_us + (first - 1 - start_us) // tick_us * tick_us,
        time_end_us=start_us - (start_us - last) // tick_us * tick_us,
        width=stream.width,
        height=stream.height,
        events=events,
        camera=stream.camera,
    )


class LeftOutWarning(UserWarning):
    """A recording has valid data that is not read, such as colour frames or another camera."""


class ReadAsWarning(UserWarning):
    """A recording does not state its chip; the message says which one it is read as, and why."""


def read(path: AnyPath, **options: Unpack[ReadOptions]) -> Recording:
    """Read all events of a recording.

    A torn tail and damaged packets are skipped, with a TornTailWarning or DamagedPacketWarning.

    Args:
        path: The recording, or the first file of one in several files (multi_file.py).
        **options: Facts that the file does not state: `columns` of a table ("t,x,y,p"), `unit` of
            its
            times ("s", "ms", "us", "ns"), the `chip` of AEDAT2. `stream` selects one of several
            event streams; `single=True` reads only this file of several.

    Returns:
        (n,) EVENT_DTYPE, with the rest of the recording in `.stream`, `.frames`, `.imu` and
        `.triggers`.

    Raises:
        EvsError: The file does not exist, its extension is unknown, it is not a recording, or its
            columns are ambiguous.
    """
    file = opened(path, **options)
    events = _joined(file.events())
    if file.integrity.unplaced and not file.integrity.resets:
        events = sort_events(events)
    _finish(file, bool(len(events)), OF_STREAM)
    return Recording.of(
        events, file.stream, AuxiliaryData(lambda: _auxiliary(path, options), file.labels)
    )


_GROWTH = 8
"""The array that collects all events grows by one part in so many, in place where it is large."""


def _joined(parts: Iterator[Events]) -> Events:
    """Concatenate parts; only one part at a time is in memory twice."""
    joined, end = empty_events(0), 0
    for part in parts:
        until = end + len(part)
        if until > len(joined):
            joined.resize(until + until // _GROWTH, refcheck=False)
        joined[end:until] = part
        end = until
    joined.resize(end, refcheck=False)
    return joined


def packets(path: AnyPath, **options: Unpack[ReadOptions]) -> Iterator[EventPacket]:
    """Read the event packets of a recording one by one, with little memory.

    Warns as `read` does, at the end.

    Args:
        path: See `read`.
        **options: See `read`.

    Yields:
        The packets, numbered from 0; their events are read-only. Ticks without events were not
        recorded and are missing.

    Raises:
        EvsError: See `read`.
    """
    file = opened(path, **options)
    seq = -1
    for seq, events in enumerate(file.events()):
        yield as_packet(seq, events, file.stream)
    _finish(file, seq >= 0, OF_STREAM)


def messages(
    path: AnyPath, **options: Unpack[ReadOptions]
) -> Iterator[EventPacket | Frame | ImuPacket | TriggerPacket]:
    """Read a recording message by message, in the recorded order.

    Warns as `read` does, at the end.

    Args:
        path: See `read`.
        **options: See `read`.

    Yields:
        Event packets, frames, IMU packets and trigger packets, each kind numbered from 0.

    Raises:
        EvsError: See `read`.
    """
    yield from messages_of(opened(path, **options))


def messages_of(file: RecordingFile) -> Iterator[EventPacket | Frame | ImuPacket | TriggerPacket]:
    """As `messages`, of an opened recording."""
    events = imu = triggers = 0
    anything = False
    for message in file.messages():
        anything = True
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
    _finish(file, anything)


def _auxiliary(path: AnyPath, options: ReadOptions) -> Iterator[Frame | ImuSamples | Triggers]:
    """The auxiliary messages; the pass over the events has warned of damage already."""
    file = opened(path, **options)
    if file.stream.frames or file.stream.imu or file.stream.triggers:
        yield from file.auxiliary()
        _warn_left_out(file)


def check_readable(file: RecordingFile, anything: bool) -> None:
    """Check that a pass over a damaged recording found something.

    Args:
        file: The recording, after the pass.
        anything: Whether the pass gave out any message.

    Raises:
        EvsError: There are damaged parts and nothing else.
    """
    report = file.integrity
    if report.packets and not anything:
        raise EvsError(
            f"{file.path} is damaged: none of its {report.packets} {report.noun} can be read, the "
            f"first {report.first}"
        )


def _finish(file: RecordingFile, anything: bool, left_out: str = "") -> None:
    """Warn after a pass, and of what was left out with this in its name. EvsError: all damaged."""
    check_readable(file, anything)
    if getattr(file, "guessed", False):
        text = f"{file.path} is read as {getattr(file, 'read_as', '')}"
        warnings.warn(text, ReadAsWarning, stacklevel=3)
    file.integrity.warn(file.path)
    _warn_left_out(file, left_out)


def _warn_left_out(file: RecordingFile, part: str = "") -> None:
    for what, count in file.left_out.items():
        if part not in what:
            continue
        text = f"{file.path}: {count} {what} were left out"
        warnings.warn(text, LeftOutWarning, stacklevel=3)


def stream_of(path: AnyPath, **options: Unpack[ReadOptions]) -> StreamInfo:
    """The description of a recording's stream: resolution, camera, seed, configuration, ...

    Raises:
        EvsError: See `read`.
    """
    options["single"] = True
    return opened(path, **options).stream


def repair(path: AnyPath) -> Repair:
    """Repair a recording in place if its format needs it; complete packets are kept.

    Args:
        path: The recording. An .npz file is either complete or unreadable.

    Returns:
        What was done.

    Raises:
        EvsError: The file cannot be read as a recording, or cannot be written.
    """
    kind = to_read(path)
    if kind.repairer:
        report: Repair = load(kind.repairer)(Path(path))
        return report
    return _truncate_tail(kind.open(Path(path)))


def _truncate_tail(file: RecordingFile) -> Repair:
    """Cut off the torn tail that reading the whole recording finds. EvsError: not writable."""
    for _ in file.messages():
        pass
    at = file.size if file.integrity.torn_at is None else file.integrity.torn_at
    report = Repair(file.path, file.size - at, at, False)
    if report.needed:
        try:
            with file.path.open("r+b") as target:
                target.truncate(at)
        except OSError as reason:
            raise target_error(file.path, reason) from None
    return report


def recorder_for(
    path: AnyPath, compression: str | None = None, *, kind: str | None = None, **options: Any
) -> Sink:
    """Make a recorder for a file, which is created when the recorder is opened.

    Args:
        path: The file to write; its extension selects the format.
        compression: lz4, none or zstd, for the formats that have it; others ignore it.
        kind: The format's name, if the extension does not select it.
        **options: Other options of the format's recorder.

    Returns:
        The recorder, not open yet.

    Raises:
        EvsError: The format is unknown, or has no such option.
    """
    chosen = to_write(path, kind)
    if compression is not None and "compression" in chosen.options:
        options["compression"] = compression
    for key in options:
        if key not in chosen.options:
            has = ", ".join(chosen.options) or "none"
            raise EvsError(f"{chosen.display_name} has no option {key}; it has: {has}")
    return chosen.record(Path(path), **options)


def opened(path: AnyPath, **options: Unpack[ReadOptions]) -> RecordingFile:
    """Open a recording and read its header. Arguments and errors are those of `read`."""
    return open_recording(path, **options)


def origin_us(file: RecordingFile) -> int:
    """The origin of user times in a recording: the first event, rounded down to a whole ms, in us.

    Stamps may be those of a camera's clock, or Unix time. 0 without events.
    """
    first = next(file.events(), None)
    return 0 if first is None else (int(first["t"][0]) - 1) // 1000 * 1000


def parts(path: AnyPath) -> list[Path]:
    """The files of the recording that begins at a path, in their order."""
    return paths_of(opened(path))
