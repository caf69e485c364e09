"""Time order of real cameras' streams: sort late events, extend 32-bit clocks, merge messages."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from evs.drivers.files.integrity import IntegrityReport
from evs.drivers.files.recording_file import by_tick, part_us
from evs.msgs import (
    EVENT_DTYPE,
    Events,
    Frame,
    ImuSamples,
    StreamInfo,
    Triggers,
    clean_events,
    join_events,
)

CLOCK_RESET_US = 1_000_000
"""A time stamp this much lower than the one before means that the clock was reset."""

REORDER_EVENTS = 8192
"""How many events are held back for others that come late but belong before them."""

MAX_REORDER_EVENTS = 1 << 20
"""A tick with more events than this is given out in several parts."""

WRAP_SLACK_US = 1 << 26
"""A clock wraps only from within 67 s of its end to within 67 s of its start."""

_WHOLE = np.dtype((np.void, EVENT_DTYPE.itemsize))


class EventSorter:
    """Sorts a stream by t as it arrives, in bounded memory, and reports what was out of order.

    Events among the last REORDER_EVENTS are sorted into their place. An event that comes later
    than that is given out in a part of its own. Where the time stamps step back by more than
    CLOCK_RESET_US, the camera's clock was reset: what follows is sorted on its own.
    """

    def __init__(self, integrity: IntegrityReport, stream: StreamInfo) -> None:
        """Start with no events.

        Args:
            integrity: Receives the steps back in time.
            stream: Its ticks are the parts that are given out.
        """
        self._integrity = integrity
        self._stream, self._tick_us = stream, part_us(stream.tick_us)
        self._parts: list[Events] = []
        self._count = 0
        self._enough = 2 * REORDER_EVENTS
        self._given_us: int | None = None
        self._before_us: int | None = None

    def feed(self, events: Events, offsets: npt.NDArray[np.int64]) -> Iterator[Events]:
        """Add events and give out those that no later event can precede.

        Args:
            events: (n,) EVENT_DTYPE, as recorded.
            offsets: (n,) byte offset of each, for the report.

        Yields:
            Sorted parts, (m,) with m > 0, one for each tick.
        """
        if not len(events):
            return
        stamps = events["t"]
        before = stamps[0] if self._before_us is None else np.int64(self._before_us)
        steps = np.diff(stamps, prepend=before)
        self._before_us = int(stamps[-1])
        back = np.flatnonzero(steps < 0)
        resets = back[steps[back] < -CLOCK_RESET_US]
        if len(back):
            self._integrity.backwards(len(back) - len(resets), len(resets), int(offsets[back[0]]))
        begin = 0
        for reset in resets.tolist():
            self._take(events[begin:reset])
            yield from self.flush()
            begin = reset
        self._take(events[begin:])
        if self._count >= self._enough:
            yield from self._ready()

    def flush(self) -> Iterator[Events]:
        """Give out all events that are held back; afterwards a new stream may begin."""
        if self._count:
            yield from self._give(self._joined())
        self._parts, self._count, self._enough, self._given_us = [], 0, 2 * REORDER_EVENTS, None

    def _take(self, events: Events) -> None:
        if len(events):
            self._parts.append(events)
            self._count += len(events)

    def _joined(self) -> Events:
        joined = join_events(self._parts) if len(self._parts) != 1 else self._parts[0]
        stamps = joined["t"]
        return sort_events(joined) if (stamps[1:] < stamps[:-1]).any() else joined

    def _ready(self) -> Iterator[Events]:
        """All but the last REORDER_EVENTS events, up to the end of a tick."""
        joined = self._joined()
        ready = len(joined) - REORDER_EVENTS
        begun_us = (int(joined["t"][ready]) - 1 - self._stream.start_us) % self._tick_us
        tick_begin_us = int(joined["t"][ready]) - 1 - begun_us
        whole = int(np.searchsorted(joined["t"], tick_begin_us, side="right"))
        # a tick that never ends is cut
        ready = whole if whole or len(joined) < MAX_REORDER_EVENTS else ready
        yield from self._give(joined[:ready])
        self._parts = [joined[ready:]]
        self._count = len(self._parts[0])
        # what is held is looked at again when there is as much more
        self._enough = self._count + max(REORDER_EVENTS, self._count)

    def _give(self, events: Events) -> Iterator[Events]:
        if not len(events):
            return
        late = 0
        if self._given_us is not None and int(events["t"][0]) < self._given_us:
            late = int(np.searchsorted(events["t"], self._given_us))
        last_us = int(events["t"][-1])
        self._given_us = last_us if self._given_us is None else max(self._given_us, last_us)
        for part in (events[:late], events[late:]):
            yield from by_tick(part, self._stream)


def in_order(
    pieces: Iterable[tuple[npt.NDArray[np.int64], Events]],
    stream: StreamInfo,
    integrity: IntegrityReport,
) -> Iterator[Events]:
    """Sort the events of a file and leave out those that are not on the sensor.

    Args:
        pieces: (n,) the byte offset of each event and (n,) EVENT_DTYPE, as recorded.
        stream: Its sensor, and the ticks that are given out.
        integrity: Receives what was left out and what was out of order.

    Yields:
        Sorted parts, (m,) with m > 0, one for each tick.
    """
    sorter = EventSorter(integrity, stream)
    for offsets, events in pieces:
        x, y = events["x"].view(np.uint16), events["y"].view(np.uint16)
        inside = (x < stream.width) & (y < stream.height)
        if not inside.all():
            outside = np.flatnonzero(~inside)
            reason = f"outside of {stream.width} x {stream.height} px"
            integrity.corrupt(int(offsets[outside[0]]), reason, len(outside))
            offsets, events = offsets[inside], clean_events(events[inside])
        yield from sorter.feed(events, offsets)
    yield from sorter.flush()


def sort_events(events: Events) -> Events:
    """The events, (n,), sorted by t; the order within one time stamp and the padding are kept."""
    order = np.argsort(events["t"], kind="stable")
    whole = np.ascontiguousarray(events).view(_WHOLE)[order]
    sorted_events: Events = whole.view(EVENT_DTYPE)
    return sorted_events


class TimestampUnwrapper:
    """Extends time stamps of 32 bits, which wrap from 2^31 - 1 us to -2^31 or to 0, to 64 bits."""

    def __init__(self, begin_us: int = 0) -> None:
        self._offset_us = begin_us
        self._before: int | None = None

    def __call__(self, stamps: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """(n,) int64 us, unchanged before the first wrap, of the next int32 values, (n,)."""
        if not len(stamps):
            return stamps
        before = stamps[0] if self._before is None else np.int64(self._before)
        steps = np.diff(stamps, prepend=before)
        self._before = int(stamps[-1])
        if int(steps.min()) > -(1 << 31) + WRAP_SLACK_US:
            only_shifted: npt.NDArray[np.int64] = stamps + self._offset_us
            return only_shifted
        signed = steps <= -(1 << 32) + WRAP_SLACK_US
        plain = (steps > -(1 << 31)) & (steps <= -(1 << 31) + WRAP_SLACK_US) & (stamps >= 0)
        offsets = np.cumsum((signed.astype(np.int64) << 32) + (plain.astype(np.int64) << 31))
        whole: npt.NDArray[np.int64] = stamps + (self._offset_us + offsets)
        self._offset_us += int(offsets[-1])
        return whole


AuxiliaryMessage = Frame | ImuSamples | Triggers
Message = Events | AuxiliaryMessage

MAX_WAITING = 64
"""Most messages that wait for the events of their time; a frame is large."""


class Interleaver:
    """Holds auxiliary messages until the events of their time, which their reader may delay."""

    def __init__(self, max_waiting: int = MAX_WAITING) -> None:
        self._max_waiting = max_waiting
        self._waiting: list[tuple[int, AuxiliaryMessage]] = []

    def add(self, t_us: int, message: AuxiliaryMessage) -> Iterator[AuxiliaryMessage]:
        """Add a message of time t_us; yields the oldest one where too many wait."""
        insort(self._waiting, (t_us, message), key=lambda waiting: waiting[0])
        if len(self._waiting) > self._max_waiting:
            yield self._waiting.pop(0)[1]

    def merge(self, events: Events) -> Iterator[Message]:
        """Yield all messages up to the last of the events, (n,) with n > 0, then the events."""
        until_us = int(events["t"][-1])
        while self._waiting and self._waiting[0][0] <= until_us:
            yield self._waiting.pop(0)[1]
        yield events

    def flush(self) -> Iterator[AuxiliaryMessage]:
        """Yield all messages that still wait."""
        while self._waiting:
            yield self._waiting.pop(0)[1]
