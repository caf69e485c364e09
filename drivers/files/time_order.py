"""Time order of real cameras' streams: sort late events, extend 32-bit clocks, merge messages."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable, Iterator
from typing import Any, Generic, Literal, TypeVar

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
"""How many events are collected before any are given out, and held back in recordings of evs."""

MAX_REORDER_EVENTS = 1 << 20
"""Most events that are held back for late ones, which are then less than a second late."""

MAX_HELD_BYTES = 1 << 26
"""Most bytes of frames and other messages that wait for the events before them."""

WRAP_SLACK_US = 1 << 26
"""A clock wraps only from within 67 s of its end to within 67 s of its start."""

AuxiliaryMessage = Frame | ImuSamples | Triggers
Message = Events | AuxiliaryMessage
Item = TypeVar("Item")

_WHOLE = np.dtype((np.void, EVENT_DTYPE.itemsize))


class _Held(Generic[Item]):
    """Messages in the order recorded, and events among them that late ones are sorted into.

    An event that is at most CLOCK_RESET_US late finds its place among the MAX_REORDER_EVENTS before
    it. What comes later than that is given out in a part of its own. Where the time stamps step
    back by more than CLOCK_RESET_US, the camera's clock was reset: what follows is sorted on its
    own. A subclass says what is given out, and when.
    """

    def __init__(self, integrity: IntegrityReport) -> None:
        self._integrity = integrity
        self._items: list[Events | Item] = []
        self._count = 0
        self._enough = 2 * REORDER_EVENTS
        self._most_held = MAX_REORDER_EVENTS
        self._given_us: int | None = None
        self._newest_us: int | None = None
        self._before_us: int | None = None

    def _feed(
        self, events: Events, offsets: npt.NDArray[np.int64]
    ) -> Iterator[Literal["full", "reset"] | Events]:
        """Hold events; yields what is too late, "reset" where all is to be given out, or "full"."""
        if not len(events):
            return
        stamps = events["t"]
        before = stamps[0] if self._before_us is None else np.int64(self._before_us)
        steps = np.diff(stamps, prepend=before)
        self._before_us = int(stamps[-1])
        newest_us = int(stamps[0]) if self._newest_us is None else self._newest_us
        if int(steps.min()) >= 0 and int(stamps[0]) >= newest_us:
            self._append(events)
            self._newest_us = int(stamps[-1])
        else:
            begin = 0
            for reset in np.flatnonzero(steps < -CLOCK_RESET_US).tolist():
                yield from self._take(events[begin:reset], offsets[begin:reset])
                self._integrity.backwards(0, 1, int(offsets[reset]))
                yield "reset"
                begin = reset
            yield from self._take(events[begin:], offsets[begin:])
        if self._count >= self._enough:
            yield "full"

    def _take(self, events: Events, offsets: npt.NDArray[np.int64]) -> Iterator[Events]:
        """Hold events without a reset among them; yields those that are too late."""
        if not len(events):
            return
        stamps = events["t"]
        highest = np.maximum.accumulate(stamps)
        if self._newest_us is not None:
            highest = np.maximum(highest, self._newest_us)
        self._newest_us = int(highest[-1])
        late = stamps < highest
        if not late.any():
            self._append(events)
            return
        self._integrity.backwards(int(np.count_nonzero(late)), 0, int(offsets[late.argmax()]))
        self._append(_selected(events, ~late))
        yield from self._insert(sort_events(_selected(events, late)))

    def _append(self, events: Events) -> None:
        if len(events):
            self._items.append(events)
            self._count += len(events)

    def _insert(self, late: Events) -> Iterator[Events]:
        """Sort late events, (n,) in order, into the parts that are held; yields the rest."""
        places = [k for k, one in enumerate(self._items) if isinstance(one, np.ndarray)
                  and one.dtype == EVENT_DTYPE]  # fmt: skip
        begins = np.array([self._items[k]["t"][0] for k in places], np.int64)  # type: ignore[index]
        where = np.searchsorted(begins, late["t"], side="right") - 1
        # what precedes every part goes into the first, if nothing later was given out
        missed = where < 0
        if self._given_us is not None:
            missed &= late["t"] < self._given_us
        elif places:
            missed[:] = False
        if missed.any():
            self._integrity.unplaced += int(np.count_nonzero(missed))
            yield _selected(late, missed)
        for place in np.unique(where[~missed]).tolist():
            group = _selected(late, (where == place) & ~missed)
            self._count += len(group)
            if not places:
                self._items.append(group)
                continue
            k = places[max(0, place)]
            # a stable sort: what was recorded first stays first
            self._items[k] = sort_events(join_events([self._items[k], group]))

    def _horizon_us(self) -> int:
        """Events up to here are given out."""
        horizon_us = (self._newest_us or 0) - CLOCK_RESET_US
        left = self._most_held
        for one in reversed(self._items):
            if isinstance(one, np.ndarray) and one.dtype == EVENT_DTYPE:
                left -= len(one)
                if left <= 0:
                    return max(horizon_us, int(one["t"][-left]))
        return horizon_us

    def _gave(self, events: Events) -> None:
        last_us = int(events["t"][-1])
        self._given_us = last_us if self._given_us is None else max(self._given_us, last_us)
        self._count -= len(events)

    def _restart(self) -> None:
        self._items, self._count, self._enough = [], 0, 2 * REORDER_EVENTS
        self._given_us = self._newest_us = None


class EventSorter(_Held[Events]):
    """Sorts a stream by t as it arrives, in bounded memory, and reports what was out of order."""

    def __init__(self, integrity: IntegrityReport, stream: StreamInfo) -> None:
        """Start with no events.

        Args:
            integrity: Receives the steps back in time.
            stream: Its ticks are the parts that are given out.
        """
        super().__init__(integrity)
        self._stream, self._tick_us = stream, part_us(stream.tick_us)
        # what a run of evs recorded has its versions, and is in order
        self._most_held = REORDER_EVENTS if stream.versions else MAX_REORDER_EVENTS

    def feed(self, events: Events, offsets: npt.NDArray[np.int64]) -> Iterator[Events]:
        """Add events and give out those that no later event can precede.

        Args:
            events: (n,) EVENT_DTYPE, as recorded.
            offsets: (n,) byte offset of each, for the report.

        Yields:
            Sorted parts, (m,) with m > 0, one for each tick.
        """
        for found in self._feed(events, offsets):
            if isinstance(found, np.ndarray):
                yield from by_tick(found, self._stream)
            elif found == "reset":
                yield from self.flush()
            else:
                yield from self._ready()

    def flush(self) -> Iterator[Events]:
        """Give out all events that are held back; afterwards a new stream may begin."""
        while self._items:
            yield from self._give(self._tick_end(int(self._items[0]["t"][-1])))
        self._restart()

    def _ready(self) -> Iterator[Events]:
        """Whole ticks up to the horizon; a tick that never ends is cut."""
        horizon_us = self._horizon_us()
        until_us = self._tick_end(horizon_us) - self._tick_us
        if self._count >= 2 * MAX_REORDER_EVENTS and int(self._items[0]["t"][0]) > until_us:
            until_us = horizon_us
        while self._items and int(self._items[0]["t"][0]) <= until_us:
            yield from self._give(min(until_us, self._tick_end(int(self._items[0]["t"][-1]))))
        # what is held is looked at again when there is an eighth more
        self._enough = self._count + max(REORDER_EVENTS, self._count // 8)

    def _tick_end(self, t_us: int) -> int:
        """End of the tick that a time lies in."""
        return t_us + (self._stream.start_us - t_us) % self._tick_us

    def _give(self, until_us: int) -> Iterator[Events]:
        """Give out the events up to a time, a part for each tick."""
        joined = join_events(self._up_to(until_us))
        self._gave(joined)
        yield from by_tick(joined, self._stream)

    def _up_to(self, until_us: int) -> list[Events]:
        """Take the events up to a time out of what is held."""
        ready: list[Events] = []
        while self._items and int(self._items[0]["t"][0]) <= until_us:
            first = self._items[0]
            cut = int(np.searchsorted(first["t"], until_us, side="right"))
            ready.append(first[:cut])
            if cut < len(first):
                self._items[0] = first[cut:]
                break
            del self._items[0]
        return ready


class PacketSorter(_Held[Any]):
    """Sorts late events into the packets before them; packets and other messages keep their order.

    Other messages wait with the packets that were recorded before them.
    """

    def __init__(self, integrity: IntegrityReport) -> None:
        """Start with no messages; `integrity` receives the steps back in time."""
        super().__init__(integrity)
        self._bytes = 0

    def feed(self, events: Events, at: int) -> Iterator[Any]:
        """Add a packet, (n,) EVENT_DTYPE as recorded at a byte offset; yields messages."""
        for found in self._feed(events, np.broadcast_to(np.int64(at), len(events))):
            if isinstance(found, np.ndarray):
                yield found
            elif found == "reset":
                yield from self.flush()
            else:
                yield from self._ready()

    def add(self, message: AuxiliaryMessage) -> Iterator[Any]:
        """Add another message; yields messages where nothing waits or too much does."""
        self._items.append(message)
        self._bytes += _bytes_of(message)
        if self._bytes > MAX_HELD_BYTES or not self._count:
            yield from self._all()

    def flush(self) -> Iterator[Any]:
        """Give out all messages; afterwards a new stream may begin."""
        yield from self._all()
        self._restart()

    def _all(self) -> Iterator[Any]:
        items, self._items, self._bytes = self._items, [], 0
        for one in items:
            if _is_events(one):
                self._gave(one)
            yield one

    def _ready(self) -> Iterator[Any]:
        until_us, ready = self._horizon_us(), 0
        for one in self._items:
            if _is_events(one):
                if int(one["t"][-1]) > until_us:
                    break
                self._gave(one)
            else:
                self._bytes -= _bytes_of(one)
            ready += 1
        items, self._items = self._items[:ready], self._items[ready:]
        self._enough = self._count + max(REORDER_EVENTS, self._count // 8)
        yield from items


def _is_events(item: Any) -> bool:
    return isinstance(item, np.ndarray) and item.dtype == EVENT_DTYPE


def _bytes_of(message: AuxiliaryMessage) -> int:
    return int((message.pixels if isinstance(message, Frame) else message).nbytes)


def _selected(events: Events, mask: npt.NDArray[np.bool_]) -> Events:
    """The events of a mask, (n,); a mask keeps no padding of zeros, whole events do."""
    whole = np.ascontiguousarray(events).view(_WHOLE)[mask]
    selected: Events = whole.view(EVENT_DTYPE)
    return selected


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


class Interleaver:
    """Holds auxiliary messages until the events of their time, which their reader may delay."""

    def __init__(self) -> None:
        self._waiting: list[tuple[int, AuxiliaryMessage]] = []
        self._bytes = 0

    def add(self, t_us: int, message: AuxiliaryMessage) -> Iterator[AuxiliaryMessage]:
        """Add a message of time t_us; yields the oldest ones where too much waits."""
        insort(self._waiting, (t_us, message), key=lambda waiting: waiting[0])
        self._bytes += _bytes_of(message)
        while self._bytes > MAX_HELD_BYTES:
            yield self._next()

    def merge(self, events: Events) -> Iterator[Message]:
        """Yield all messages up to the last of the events, (n,) with n > 0, then the events."""
        until_us = int(events["t"][-1])
        while self._waiting and self._waiting[0][0] <= until_us:
            yield self._next()
        yield events

    def flush(self) -> Iterator[AuxiliaryMessage]:
        """Yield all messages that still wait."""
        while self._waiting:
            yield self._next()

    def _next(self) -> AuxiliaryMessage:
        message = self._waiting.pop(0)[1]
        self._bytes -= _bytes_of(message)
        return message
