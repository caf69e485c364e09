"""The time that each frame of a clip shows: constant speed and frame rate, without drift."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from evs.msgs import Events, EvsError


@dataclass(frozen=True)
class Playback:
    """A stretch of a recording shown at `speed` times real time.

    Frame k ends at start_us + (k + 1) * speed / fps, rounded to 1 us, and shows the window_us
    before its end. Raises EvsError on values that cannot be played.
    """

    start_us: int
    stop_us: int
    fps: float = 25.0
    """pictures per second of the viewer's time"""
    speed: float = 0.25
    """stream seconds per viewer's second: 1 is real time, 0.25 slow motion"""
    window_us: int | None = None
    """how much time one frame shows, us; None: what passes between two frames, each event once"""

    def __post_init__(self) -> None:
        for name, value in (("fps", self.fps), ("speed", self.speed)):
            if not (math.isfinite(value) and value > 0):
                raise EvsError(f"{name} is {value:g}: give a number above 0")
        if self.window_us is not None and self.window_us <= 0:
            raise EvsError(f"window is {self.window_us} us: give at least 0.001 ms")
        if self.stop_us <= self.start_us:
            raise EvsError(
                f"nothing to show from {self.start_us / 1e6:g} s to {self.stop_us / 1e6:g} s: "
                "stop must be after start"
            )
        if self.step_us < 1:
            raise EvsError(
                f"speed {self.speed:g} at {self.fps:g} fps is less than 1 us a frame: raise speed"
            )

    @property
    def step_us(self) -> float:
        """Stream time between two frames, us."""
        return 1e6 * self.speed / self.fps

    @property
    def frame_count(self) -> int:
        """Number of frames, at least 1; the last one may reach beyond stop_us."""
        # a hair of tolerance: 2 s in steps of 10 ms is 200 frames although 0.25 / 25 is not exact
        return max(1, math.ceil((self.stop_us - self.start_us) / self.step_us - 1e-6))

    def frame_window(self, index: int) -> tuple[int, int]:
        """(begin_us, end_us] of frame `index`."""
        end_us = self._end_us(index)
        if self.window_us is None:
            return self._end_us(index - 1), end_us
        return end_us - self.window_us, end_us

    def windows(self) -> Iterator[tuple[int, int]]:
        """The windows of all frames in order."""
        return (self.frame_window(index) for index in range(self.frame_count))

    def durations_cs(self) -> list[int]:
        """How long each frame stays, in GIF's unit of 10 ms; sums are right to 10 ms at any fps."""
        edges = [round(100 * index / self.fps) for index in range(self.frame_count + 1)]
        return [after - before for before, after in itertools.pairwise(edges)]

    def _end_us(self, index: int) -> int:
        return self.start_us + round((index + 1) * self.step_us)


def span_us(events: Events) -> tuple[int, int]:
    """(start, stop) in whole ms around all events: start < t <= stop. (0, 1000) without events."""
    if not len(events):
        return 0, 1000
    first, last = int(events["t"][0]), int(events["t"][-1])
    return (first - 1) // 1000 * 1000, max(-(-last // 1000) * 1000, (first - 1) // 1000 * 1000 + 1)


def speed_words(speed: float) -> str:
    """`1/4 real time`, `real time`, `2x real time`: the playback speed for captions."""
    fraction = Fraction(speed).limit_denominator(1000)
    if fraction == 1:
        return "real time"
    if fraction.numerator == 1 and math.isclose(float(fraction), speed, rel_tol=1e-6):
        return f"1/{fraction.denominator} real time"
    return f"{speed:g}x real time"
