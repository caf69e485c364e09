"""What is wrong with a recording that is being read, and how the reader's user hears of it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evs.msgs import Events, StreamInfo, clean_events, make_events

MAX_STAMP_US = 1 << 62
"""Time stamps beyond it (146,000 years) are damage; sums with them would overflow int64."""


class TornTailWarning(UserWarning):
    """The end of a recording could not be read; the message names the byte offset."""


class DamagedPacketWarning(UserWarning):
    """A recording holds damaged packets between whole ones; they were left out."""


class BackwardsWarning(UserWarning):
    """Time stamps of a recording run backwards; where they could be, the events were sorted."""


@dataclass
class Damage:
    """What one walk over a file met besides whole packets."""

    torn_at: int | None = None
    """byte offset at which the readable part ends; None: nothing is torn"""
    torn_bytes: int = 0
    packets: int = 0
    """damaged packets that lie between whole ones"""
    first: str = ""
    """place and reason of the first of them"""
    what: str = "packets"
    """what they are called: packets, words, lines"""
    unsorted: int = 0
    """events with a lower stamp than the one before, which were sorted"""
    resets: int = 0
    """places at which the stamps step back by so much that the clock must have been set anew"""
    backwards_at: int | None = None
    """place of the first event with a lower stamp than the one before"""
    unit: str = "byte"
    """what that place counts"""

    def packet(self, at: int, reason: str, count: int = 1) -> None:
        """Something that is no packet of sound values, and a whole packet follows it."""
        self.lost(f"at byte {at}", reason, count)

    def lost(self, where: str, reason: str, count: int = 1) -> None:
        """The same, where a library reads the file and tells no offset."""
        self.first = self.first or f"{where}: {reason}"
        self.packets += count

    def backwards(self, unsorted: int, resets: int, at: int) -> None:
        """So many steps back in time, the first at the byte offset `at`."""
        self.unsorted += unsorted
        self.resets += resets
        self.backwards_at = at if self.backwards_at is None else self.backwards_at

    def tail(self, at: int, end: int) -> None:
        """Nothing whole lies between the byte offsets `at` and `end`."""
        if at < end:
            self.torn_at, self.torn_bytes = at, end - at

    def warn(self, path: Path) -> None:
        """One warning for a torn tail, one for damaged packets; none for a sound file."""
        if self.torn_at is not None:
            text = (
                f"{path}: {self.torn_bytes} bytes at offset {self.torn_at} are no whole packet and "
                f"were left out; `evs info --repair {path}` cuts them"
            )
            warnings.warn(text, TornTailWarning, stacklevel=3)
        if self.packets:
            text = (
                f"{path}: {self.packets} damaged {self.what} were left out, the first {self.first}"
            )
            warnings.warn(text, DamagedPacketWarning, stacklevel=3)
        if self.backwards_at is not None:
            text = f"{path}: {self.backwards_words()}"
            warnings.warn(text, BackwardsWarning, stacklevel=3)

    def backwards_words(self) -> str:
        """One line on stamps that run backwards; empty if none do."""
        if self.backwards_at is None:
            return ""
        told = []
        if self.unsorted:
            told.append(f"{self.unsorted} time stamps ran backwards and were sorted")
        if self.resets:
            told.append(f"time begins anew {self.resets} times, as after a reset of the clock")
        return f"{'; '.join(told)}; the first at {self.unit} {self.backwards_at}"


def bad_values(events: Events, stream: StreamInfo) -> str:
    """Why these events, (n,) with n > 0 and sorted, cannot be of the stream; empty if they can."""
    stamps = events["t"]
    if int(stamps[0]) < -MAX_STAMP_US or int(stamps[-1]) > MAX_STAMP_US:
        return "its time stamps are beyond 2^62 us"
    for axis, side in (("x", stream.width), ("y", stream.height)):
        low, high = int(events[axis].min()), int(events[axis].max())
        if low < 0 or (side and high >= side):
            return f"{axis} reaches from {low} to {high} on a sensor of {side} px"
    return ""


def on_sensor(events: Events, width: int, height: int) -> tuple[Events, int]:
    """The events, (n,), that lie on a sensor of this size, px, and how many do not."""
    right = (events["x"].view(np.uint16) < width) & (events["y"].view(np.uint16) < height)
    wrong = len(events) - int(np.count_nonzero(right))
    return (clean_events(events[right]), wrong) if wrong else (events, 0)


def normalised(events: Events) -> Events:
    """The events with p 0 or 1 and zero padding; a copy only where they have not."""
    clean = clean_events(events)
    if int(clean["p"].view(np.uint8).max(initial=0)) <= 1:
        return clean
    signs = clean["p"] != 0
    return make_events(clean["t"], clean["x"], clean["y"], signs)
