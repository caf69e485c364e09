"""Observed: the events of one recording of a camera, sorted by pixel, checked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs import Events, EvsError, Frame

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

MAX_PIXELS = 1 << 26
"""of a sensor: several arrays of this many numbers are made"""

FEWEST = 2
"""events of a recording that tells anything"""


@dataclass(frozen=True)
class Intervals:
    """The intervals between successive events of the same pixel, sorted by pixel."""

    pixel: I64
    begin_us: I64
    length_us: I64
    before_on: Mask
    """polarity of the event before"""
    after_on: Mask


@dataclass(frozen=True, eq=False)
class Observed:
    """A recording. Raises EvsError if it tells nothing at all."""

    events: Events
    """(n,) EVENT_DTYPE, sorted by t"""
    width: int
    height: int
    source: str = "recording"
    """its name in tables and comments"""
    frames: tuple[Frame, ...] = ()
    """intensity frames of the same pixels"""

    def __post_init__(self) -> None:
        events = np.asarray(self.events)
        if self.width * self.height > MAX_PIXELS:
            raise EvsError(
                f"{self.source}: its sensor has {self.width} x {self.height} px, more than any; a "
                "damaged event may lie far outside"
            )
        if len(events) < FEWEST:
            count = "no events" if not len(events) else f"{len(events)} event"
            raise EvsError(f"{self.source} has {count}; record some seconds with the camera on")
        if np.any(np.diff(events["t"]) < 0):
            raise EvsError(
                f"{self.source}: its time stamps run backwards; cut it where the clock was reset, "
                "or record it again"
            )
        if int(events["x"].max()) >= self.width or int(events["y"].max()) >= self.height:
            raise EvsError(
                f"{self.source}: events lie outside its {self.width} x {self.height} px; "
                "the header of the file is wrong"
            )

    @classmethod
    def of(cls, recording: Any, source: str) -> Observed:
        """Of what `evs.read` gives.

        Args:
            recording: A drivers.files.Recording.
            source: Its name, for tables and comments.
        """
        stream = recording.stream
        frames = tuple(recording.frames) if stream.frames else ()
        return cls(np.asarray(recording), stream.width, stream.height, source, frames)

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.width * self.height

    @property
    def seconds(self) -> float:
        """From the first event to the last."""
        return float(self.events["t"][-1] - self.events["t"][0]) * 1e-6

    @cached_property
    def pixel(self) -> I64:
        """(n,) y * width + x of each event."""
        return np.asarray(self.events["y"].astype(np.int64) * self.width + self.events["x"])

    @cached_property
    def on(self) -> Mask:
        """(n,) whether it is an ON event."""
        return np.asarray(self.events["p"] == 1)

    @cached_property
    def order(self) -> I64:
        """(n,) places of the events sorted by pixel, then by time."""
        return np.asarray(np.argsort(self.pixel, kind="stable"), np.int64)

    @cached_property
    def on_counts(self) -> I64:
        """(pixels,) ON events of each pixel."""
        return np.bincount(self.pixel[self.on], minlength=self.pixels).astype(np.int64)

    @cached_property
    def off_counts(self) -> I64:
        """(pixels,) OFF events of each pixel."""
        return np.bincount(self.pixel[~self.on], minlength=self.pixels).astype(np.int64)

    @cached_property
    def intervals(self) -> Intervals:
        """Between successive events of the same pixel."""
        pixel, on = self.pixel[self.order], self.on[self.order]
        t_us = self.events["t"][self.order].astype(np.int64)
        same = pixel[1:] == pixel[:-1]
        return Intervals(
            pixel[1:][same],
            t_us[:-1][same],
            np.diff(t_us)[same],
            on[:-1][same],
            on[1:][same],
        )


def medians(group: I64, values: F64, groups: int) -> tuple[F64, I64]:
    """(groups,) median of the values of each group, NaN without any, and how many there are."""
    order = np.lexsort((values, group))
    ordered = values[order]
    count = np.bincount(group, minlength=groups)
    first = np.cumsum(count) - count
    middle = np.full(groups, np.nan)
    some = count > 0
    low = first[some] + (count[some] - 1) // 2
    high = first[some] + count[some] // 2
    middle[some] = 0.5 * (ordered[low] + ordered[high])
    return middle, count.astype(np.int64)
