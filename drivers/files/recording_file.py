"""RecordingFile, the interface of every reader of a recording, and base classes for readers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from evs.drivers.files.integrity import IntegrityReport
from evs.msgs import (
    EVENT_DTYPE,
    Events,
    EvsError,
    Frame,
    ImuSamples,
    Labels,
    StreamInfo,
    Triggers,
)


class RecordingFile(Protocol):
    """A recording whose header has been read.

    Each pass over its events or messages reads the file again, in little memory. A pass continues
    after corrupt data, and its end sets `integrity`.
    """

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def size(self) -> int:
        """Size of the file, bytes."""

    @property
    def stream(self) -> StreamInfo:
        """The stream as the header describes it; what is missing there is found from the events."""

    @property
    def compression(self) -> str:
        """`none`, or the name of one."""

    @property
    def integrity(self) -> IntegrityReport:
        """What the last complete pass found in addition to valid events."""

    @property
    def position(self) -> int:
        """How far the current pass has come, bytes of the file: for progress."""

    @property
    def labels(self) -> Labels | None:
        """(n,) LABEL_DTYPE, one for each event; None: it has none."""

    @property
    def left_out(self) -> Mapping[str, int]:
        """Valid data that the last complete pass did not read: what it is -> how many."""

    @property
    def streams(self) -> Mapping[str, str]:
        """The event streams of the file: key that `stream` takes -> name, the one read first."""

    @property
    def table_packets(self) -> int | None:
        """Packets in an AEDAT4 file's data table; None: it has no whole one."""

    @property
    def broken_pointer(self) -> bool:
        """Whether an AEDAT4 header points to a data table that does not exist."""

    def events(self) -> Iterator[Events]:
        """Its events in parts, sorted and not empty: one for each tick, or as they were packed."""

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """Events, frames, IMU samples and triggers in the order recorded."""

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers without the events."""


@dataclass
class EventOnlyFile(ABC):
    """Base class of readers of formats that hold only events; a subclass implements `events`."""

    path: Path
    stream: StreamInfo
    size: int
    compression: str = "none"
    integrity: IntegrityReport = field(default_factory=IntegrityReport)
    left_out: dict[str, int] = field(default_factory=dict)
    streams: dict[str, str] = field(default_factory=dict)
    position: int = 0
    labels: Labels | None = None
    table_packets: int | None = None
    broken_pointer: bool = False
    read_as: str = ""
    """what was decided on what the file does not state: columns and unit; empty: nothing"""
    guessed: bool = False
    """whether `read_as` is so uncertain that reading warns of it"""
    unfinished: bool = False
    """its recorder was killed: evs reads it, other programs need `repair` first"""

    @abstractmethod
    def events(self) -> Iterator[Events]:
        """Its events in sorted parts that are not empty; the end sets `integrity`, `left_out`."""

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """The events: there is nothing else."""
        yield from self.events()

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """No messages."""
        yield from ()


@dataclass
class MultiStreamFile(EventOnlyFile):
    """Base class of readers of formats with auxiliary streams; a subclass implements `_iterate`."""

    @abstractmethod
    def _iterate(
        self, events: bool, auxiliary: bool
    ) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """The requested messages in the order recorded; the end sets `integrity`, `left_out`."""

    def events(self) -> Iterator[Events]:
        """Its events in parts, each sorted and not empty."""
        for message in self._iterate(events=True, auxiliary=False):
            assert isinstance(message, np.ndarray)
            yield message

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """Events, frames, IMU samples and triggers in the order recorded."""
        stream = self.stream
        auxiliary = stream.frames or stream.imu or stream.triggers
        yield from self._iterate(events=True, auxiliary=auxiliary)

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers without the events."""
        for message in self._iterate(events=False, auxiliary=True):
            assert isinstance(message, Frame) or message.dtype != EVENT_DTYPE
            yield message


def choose_stream(
    path: Path, streams: Mapping[str, str], wanted: str | int | None
) -> dict[str, str]:
    """Choose the event stream of a recording that is read.

    Args:
        path: The recording.
        streams: Key -> name of its event streams, the usual one first.
        wanted: Key or name, in any case; None: the usual one.

    Returns:
        The streams, the chosen one first.

    Raises:
        EvsError: There is no such stream, or several have this name.
    """
    if wanted is None:
        return dict(streams)
    text = str(wanted)
    named = [key for key, name in streams.items() if name.lower() == text.lower()]
    chosen = [text] if text in streams else named
    if len(chosen) != 1:
        has = "several event streams" if named else "no event stream"
        listed = ", ".join(stream_title(key, name) for key, name in streams.items())
        raise EvsError(f"{path} has {has} '{text}'; choose one of: {listed or 'none'}")
    return {chosen[0]: streams[chosen[0]], **streams}


OF_STREAM = " of stream "
"""in the names of what is left out because it belongs to another stream"""


def of_stream(what: str, key: str, name: str) -> str:
    """What is left out because it belongs to a stream that was not chosen."""
    return f"{what}{OF_STREAM}{stream_title(key, name)}"


def stream_title(key: str, name: str) -> str:
    """A stream in messages."""
    return f"{key} ({name})" if name and name != key else key


def by_tick(events: Events, stream: StreamInfo) -> Iterator[Events]:
    """Split events at the ends of the stream's ticks.

    Args:
        events: (n,) with a field t, sorted by it.
        stream: A stream with ticks of 1 us has no ticks: parts of 1 ms are made.

    Yields:
        Parts that are not empty, views of the array.
    """
    if len(events):
        ticks = -((stream.start_us - events["t"]) // part_us(stream.tick_us))
        yield from np.split(events, np.flatnonzero(np.diff(ticks)) + 1)


def part_us(tick_us: int) -> int:
    """Duration of the parts in which a stream is read, us."""
    return tick_us if tick_us > 1 else 1000
