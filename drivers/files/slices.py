"""EventSlices: recordings cut into slices of time or of events, as data loaders index them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any, overload

import numpy as np

from evs.drivers.files.formats import AnyPath
from evs.drivers.files.reading import Recording, read
from evs.emulator.config.decoding import plain_integer
from evs.msgs import Events, EvsError

Encode = Callable[[Events, tuple[int, int]], Any]
"""Makes a sample of the events of a slice and of its interval (begin, end), us."""


class EventSlices(Sequence[Any]):
    """Slices of one or more recordings, one after another; no slice spans two of them.

        slices = evs.EventSlices("run.aedat4", span_us=20_000)
        slices[3]                       # the events of 60 to 80 ms after the first, a view

    It has a length and an index, so PyTorch's DataLoader accepts it directly, with any number of
    workers. Nothing is copied: a slice is a view of its recording. The last slice of a recording is
    omitted if it would be shorter.
    """

    def __init__(
        self,
        recordings: Recording | AnyPath | Sequence[Recording | AnyPath],
        *,
        span_us: int | None = None,
        count: int | None = None,
        step: int | None = None,
        encode: Encode | None = None,
    ) -> None:
        """Cut recordings.

        Args:
            recordings: Recordings, or files to read.
            span_us: Length of a slice, us. The first slice begins with the first event; slices
                without events count.
            count: Number of events of a slice, instead of span_us.
            step: Distance between the starts of two slices, in us or in events; None: no overlap.
            encode: Function that encodes a slice, for example
                `lambda events, interval: evs.voxel_grid(events, 5, (346, 260), interval)`; None:
                its events.

        Raises:
            EvsError: Neither or both of span_us and count, a number below 1, a file that cannot be
                read, or events that are not in order.
        """
        if (span_us is None) == (count is None):
            raise EvsError("give either span_us, the time of a slice, or count, its events")
        self._by_time = span_us is not None
        self._size = _positive(
            span_us if span_us is not None else count, "span_us" if self._by_time else "count"
        )
        self._step = self._size if step is None else _positive(step, "step")
        self._encode = encode
        is_one = isinstance(recordings, Recording | str | os.PathLike)
        several: Any = [recordings] if is_one else recordings
        self.recordings: tuple[Recording, ...] = tuple(
            one if isinstance(one, Recording) else read(one) for one in several
        )
        """those that are cut"""
        self._begins: list[int] = []
        """of the first slice of each, us or 0"""
        self._ends = [0]
        """number of slices up to each recording"""
        for one in self.recordings:
            begin, slices = self._cut(one)
            self._begins.append(begin)
            self._ends.append(self._ends[-1] + slices)

    def _cut(self, recording: Recording) -> tuple[int, int]:
        """Where the first slice of a recording begins, and how many there are."""
        t = np.asarray(recording["t"])
        if not len(t):
            return 0, 0
        if np.any(t[1:] < t[:-1]):
            raise EvsError(
                "the recording's events are not in order of time: sort it, as in "
                'recording[recording["t"].argsort(kind="stable")]'
            )
        begin = int(t[0]) if self._by_time else 0
        length = int(t[-1]) - begin if self._by_time else len(t)
        return begin, max(0, (length - self._size) // self._step + 1)

    def __len__(self) -> int:
        return self._ends[-1]

    @overload
    def __getitem__(self, index: int) -> Any: ...

    @overload
    def __getitem__(self, index: slice) -> list[Any]: ...

    def __getitem__(self, index: int | slice) -> Any:
        """Return slice `index`, encoded. IndexError behind the last."""
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        events, interval = self.events(index)
        return events if self._encode is None else self._encode(events, interval)

    def events(self, index: int) -> tuple[Events, tuple[int, int]]:
        """Return the events of a slice and its interval, whatever `encode` is.

        Args:
            index: Number of the slice; negative numbers count from the end.

        Returns:
            (n,) EVENT_DTYPE, a view; (begin, end), us: by time, begin <= t < end; by count, the
            stamps of its first and last event.

        Raises:
            IndexError: There is no such slice.
        """
        which, place = self._find(index)
        events = np.asarray(self.recordings[which])
        begin = self._begins[which] + place * self._step
        if self._by_time:
            interval = begin, begin + self._size
            first, last = np.searchsorted(events["t"], interval)
            return events[first:last], interval
        found = events[begin : begin + self._size]
        return found, (int(found["t"][0]), int(found["t"][-1]))

    def source(self, index: int) -> int:
        """Return the index in `recordings` of the recording of a slice, often its label."""
        return self._find(index)[0]

    def _find(self, index: int) -> tuple[int, int]:
        """Place of its recording, and its number among that one's slices. IndexError."""
        place = index + len(self) if index < 0 else index
        if not 0 <= place < len(self):
            raise IndexError(f"slice {index} of {len(self)}")
        which = int(np.searchsorted(self._ends, place, side="right")) - 1
        return which, place - self._ends[which]

    def part(self, number: int, parts: int) -> Iterator[Any]:
        """Iterate over every `parts`-th slice from `number` on, the share of one worker.

        Args:
            number: Number of the worker, from 0.
            parts: Number of workers.
        """
        for place in range(number, len(self), parts):
            yield self[place]


def _positive(value: Any, name: str) -> int:
    whole = plain_integer(value, name)
    if whole < 1:
        raise EvsError(f"{name} is {whole}; give 1 or more")
    return whole
