"""Integrity of a recording: what a reader had to skip or sort, and what a repair did."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evs.msgs import Events, StreamInfo, clean_events, make_events

MAX_STAMP_US = 1 << 62
"""Time stamps beyond it (146,000 years) are corrupt; sums with them would overflow int64."""


class TornTailWarning(UserWarning):
    """The end of a recording could not be read; the message names the byte offset."""


class DamagedPacketWarning(UserWarning):
    """A recording holds damaged packets between whole ones; they were left out."""


class BackwardsWarning(UserWarning):
    """Time stamps of a recording run backwards; where they could be, the events were sorted."""


@dataclass
class IntegrityReport:
    """What one pass over a file found in addition to whole packets."""

    torn_at: int | None = None
    """byte offset at which the readable part ends; None: nothing is torn"""
    torn_bytes: int = 0
    packets: int = 0
    """damaged packets that lie between whole ones"""
    first: str = ""
    """place and reason of the first of them"""
    noun: str = "packets"
    """what they are called: packets, words, lines"""
    unsorted: int = 0
    """events with a lower time stamp than one before, which were sorted"""
    unplaced: int = 0
    """of them: those that came too late to be sorted while the file is read"""
    resets: int = 0
    """places at which the time stamps step back so far that the clock must have been reset"""
    backwards_at: int | None = None
    """place of the first event with a lower time stamp than the one before"""
    place_unit: str = "byte"
    """what that place counts"""

    def corrupt(self, at: int, reason: str, count: int = 1) -> None:
        """Add packets without valid content; a whole packet follows them.

        Args:
            at: Byte offset of the first.
            reason: Why it is not valid.
            count: Number of packets.
        """
        self.corrupt_part(f"at byte {at}", reason, count)

    def corrupt_part(self, where: str, reason: str, count: int = 1) -> None:
        """The same as `corrupt`, where a library reads the file and reports no byte offset."""
        self.first = self.first or f"{where}: {reason}"
        self.packets += count

    def backwards(self, unsorted: int, resets: int, at: int) -> None:
        """Add steps back in time.

        Args:
            unsorted: Events that sorting puts in their place.
            resets: Steps so large that the clock must have been reset.
            at: Place of the first of them, in `place_unit`.
        """
        self.unsorted += unsorted
        self.resets += resets
        self.backwards_at = at if self.backwards_at is None else self.backwards_at

    def torn_tail(self, at: int, end: int) -> None:
        """Record that nothing whole lies between the byte offsets `at` and `end`."""
        if at < end:
            self.torn_at, self.torn_bytes = at, end - at

    def warn(self, path: Path) -> None:
        """Issue one warning for each kind of problem; none for a sound file."""
        if self.torn_at is not None:
            text = (
                f"{path}: {self.torn_bytes} bytes at offset {self.torn_at} are no whole packet and "
                f"were left out; `evs info --repair {path}` cuts them"
            )
            warnings.warn(text, TornTailWarning, stacklevel=3)
        if self.packets:
            text = (
                f"{path}: {self.packets} damaged {self.noun} were left out, the first {self.first}"
            )
            warnings.warn(text, DamagedPacketWarning, stacklevel=3)
        if self.backwards_at is not None:
            text = f"{path}: {self.backwards_text()}"
            warnings.warn(text, BackwardsWarning, stacklevel=3)

    def backwards_text(self) -> str:
        """One line about time stamps that run backwards; empty if none do."""
        if self.backwards_at is None:
            return ""
        parts = []
        if self.unsorted:
            parts.append(f"{self.unsorted} time stamps ran backwards and were sorted")
        if self.resets:
            parts.append(f"time begins anew {self.resets} times, as after a reset of the clock")
        return f"{'; '.join(parts)}; the first at {self.place_unit} {self.backwards_at}"


def bad_values(events: Events, stream: StreamInfo) -> str:
    """Why these events, (n,) with n > 0, cannot be of the stream; empty if they can."""
    stamps = events["t"]
    if int(stamps.min()) < -MAX_STAMP_US or int(stamps.max()) > MAX_STAMP_US:
        return "its time stamps are beyond 2^62 us"
    for axis, side in (("x", stream.width), ("y", stream.height)):
        low, high = int(events[axis].min()), int(events[axis].max())
        if low < 0 or (side and high >= side):
            return f"{axis} reaches from {low} to {high} on a sensor of {side} px"
    return ""


def on_sensor(events: Events, width: int, height: int) -> tuple[Events, int]:
    """Keep the events that lie on the sensor.

    Args:
        events: (n,) EVENT_DTYPE.
        width: Sensor width, px.
        height: Sensor height, px.

    Returns:
        (m,) the events on the sensor, and how many are not.
    """
    inside = (events["x"].view(np.uint16) < width) & (events["y"].view(np.uint16) < height)
    outside = len(events) - int(np.count_nonzero(inside))
    return (clean_events(events[inside]), outside) if outside else (events, 0)


def normalised(events: Events) -> Events:
    """The events with p 0 or 1 and zero padding; copied only where they differ from that."""
    clean = clean_events(events)
    if int(clean["p"].view(np.uint8).max(initial=0)) <= 1:
        return clean
    on = clean["p"] != 0
    return make_events(clean["t"], clean["x"], clean["y"], on)


@dataclass(frozen=True)
class Repair:
    """The result of `repair`."""

    path: Path
    cut_bytes: int
    """bytes cut from the end; 0: there was no torn tail"""
    cut_at: int
    """size of the file now, bytes"""
    pointer_reset: bool
    """the header pointed to a data table that is not there"""
    done: str = ""
    """what else was done, in words"""

    @property
    def needed(self) -> bool:
        """Whether anything was changed."""
        return bool(self.cut_bytes) or self.pointer_reset or bool(self.done)

    def __str__(self) -> str:
        """One line for people."""
        if not self.needed:
            return f"{self.path} needs no repair"
        done = []
        if self.cut_bytes:
            done.append(f"cut {self.cut_bytes} bytes at offset {self.cut_at}")
        if self.pointer_reset:
            done.append("removed the pointer to a missing data table")
        if self.done:
            done.append(self.done)
        return f"{self.path}: {' and '.join(done)}; every whole packet is kept"
