"""RecordedFile: what every reader of a recording gives; EventsFile: what most of them share."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from evs.drivers.files.damage import Damage
from evs.msgs import (
    EVENT_DTYPE,
    Events,
    Frame,
    ImuSamples,
    Labels,
    StreamInfo,
    Triggers,
)


class RecordedFile(Protocol):
    """A recording whose header was read; each walk over it reads the file anew, in little memory.

    A walk goes on behind what is damaged, and its end sets `damage`.
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
    def damage(self) -> Damage:
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

    def beside(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers alone."""


@dataclass
class EventsFile(ABC):
    """A RecordedFile that holds events alone; a reader of one format gives `events`."""

    path: Path
    stream: StreamInfo
    size: int
    compression: str = "none"
    damage: Damage = field(default_factory=Damage)
    left_out: dict[str, int] = field(default_factory=dict)
    position: int = 0
    labels: Labels | None = None
    table_packets: int | None = None
    broken_pointer: bool = False
    unfinished: bool = False
    """its recorder was killed: we read it, others want what `repair` gives it"""

    @abstractmethod
    def events(self) -> Iterator[Events]:
        """Its events in parts, each sorted and not empty; the end sets `damage` and `left_out`."""

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """The events, since there is nothing else."""
        yield from self.events()

    def beside(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Nothing."""
        yield from ()


@dataclass
class MixedFile(EventsFile):
    """A RecordedFile that may hold more than events; a reader gives `_walked`."""

    @abstractmethod
    def _walked(
        self, events: bool, beside: bool
    ) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """What is asked for, in the order recorded; the end sets `damage` and `left_out`."""

    def events(self) -> Iterator[Events]:
        """Its events in parts, each sorted and not empty."""
        for message in self._walked(events=True, beside=False):
            assert isinstance(message, np.ndarray)
            yield message

    def messages(self) -> Iterator[Events | Frame | ImuSamples | Triggers]:
        """Events, frames, IMU samples and triggers in the order recorded."""
        stream = self.stream
        beside = stream.frames or stream.imu or stream.triggers
        yield from self._walked(events=True, beside=beside)

    def beside(self) -> Iterator[Frame | ImuSamples | Triggers]:
        """Frames, IMU samples and triggers alone."""
        for message in self._walked(events=False, beside=True):
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


def said_stream(said: Any, plain: StreamInfo) -> StreamInfo:
    """A StreamInfo from what a header's JSON says; `plain` where it says nothing usable.

    In: said, what json.loads gave; plain, the stream of a file that says nothing.
    """
    from dataclasses import fields, replace

    from evs.drivers.files.formats import MAX_SIDE_PX

    if not isinstance(said, dict):
        return plain
    known = {
        item.name: said[item.name]
        for item in fields(StreamInfo)
        if type(said.get(item.name)) is type(getattr(plain, item.name))
    }
    stream = replace(plain, **known)
    sides = stream.width, stream.height
    possible = all(0 < side <= MAX_SIDE_PX for side in sides) and stream.tick_us > 0
    return stream if possible else plain
