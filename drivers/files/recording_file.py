"""RecordingFile: what every reader of a recording gives; EventOnlyFile: what most of them share."""

from __future__ import annotations

import os
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
    Frame,
    ImuSamples,
    Labels,
    StreamInfo,
    Triggers,
)


class RecordingFile(Protocol):
    """A recording whose header was read; each walk over it reads the file anew, in little memory.

    A walk goes on behind what is damaged, and its end sets `integrity`.
    """

    @property
    def path(self) -> Path:
        """Where it lies."""

    @property
    def size(self) -> int:
        """Bytes."""

    @property
    def stream(self) -> StreamInfo:
        """What it says of its stream; where it says nothing, what its events need."""

    @property
    def compression(self) -> str:
        """`none`, or the name of one."""

    @property
    def integrity(self) -> IntegrityReport:
        """What the last complete walk met besides sound events."""

    @property
    def position(self) -> int:
        """How far the present walk is, bytes of the file: for progress."""

    @property
    def labels(self) -> Labels | None:
        """(n,) as its events; None: it has none."""

    @property
    def left_out(self) -> Mapping[str, int]:
        """What the last complete walk met that is sound but not read: what it is -> how many."""

    @property
    def table_packets(self) -> int | None:
        """Packets in an AEDAT4 file's data table; None: there is no whole one."""

    @property
    def broken_pointer(self) -> bool:
        """An AEDAT4 header points to a data table that is not there."""

    def events(self) -> Iterator[Events]:
        """Its events in parts, each sorted and not empty: one a tick, or as they were packed."""

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """Events, frames, IMU samples and triggers in the order recorded."""

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers alone."""


@dataclass
class EventOnlyFile(ABC):
    """A RecordingFile that holds events alone; a reader of one format gives `events`."""

    path: Path
    stream: StreamInfo
    size: int
    compression: str = "none"
    integrity: IntegrityReport = field(default_factory=IntegrityReport)
    left_out: dict[str, int] = field(default_factory=dict)
    position: int = 0
    labels: Labels | None = None
    table_packets: int | None = None
    broken_pointer: bool = False
    unfinished: bool = False
    """its recorder was killed: we read it, others want what `repair` gives it"""

    @abstractmethod
    def events(self) -> Iterator[Events]:
        """Its events in sorted parts that are not empty; the end sets `integrity`, `left_out`."""

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """The events, since there is nothing else."""
        yield from self.events()

    def auxiliary(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Nothing."""
        yield from ()


@dataclass
class MultiStreamFile(EventOnlyFile):
    """A RecordingFile that may hold more than events; a reader gives `_iterate`."""

    @abstractmethod
    def _iterate(
        self, events: bool, auxiliary: bool
    ) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """What is asked for, in the order recorded; the end sets `integrity` and `left_out`."""

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
        """Frames, IMU samples and triggers alone."""
        for message in self._iterate(events=False, auxiliary=True):
            assert isinstance(message, Frame) or message.dtype != EVENT_DTYPE
            yield message


def by_tick(events: Events, stream: StreamInfo) -> Iterator[Events]:
    """Sorted events, (n,), cut where a tick of the stream ends; each part is a view.

    A tick of 1 us is that of a stream without ticks: it is cut into parts of 1 ms.
    """
    if len(events):
        ticks = -((stream.start_us - events["t"]) // part_us(stream.tick_us))
        yield from np.split(events, np.flatnonzero(np.diff(ticks)) + 1)


def part_us(tick_us: int) -> int:
    """How long the parts are that a stream is read in, us."""
    return tick_us if tick_us > 1 else 1000


def size_of(path: str | os.PathLike[str]) -> int:
    """Bytes of a file."""
    return Path(path).stat().st_size
