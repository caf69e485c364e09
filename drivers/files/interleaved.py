"""Frames and IMU samples of a stream, put back between its events by their times."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator

from evs.msgs import Events, Frame, ImuSamples, Triggers

Message = Events | Frame | ImuSamples | Triggers

MOST_WAITING = 64
"""So many messages wait for the events of their time at most."""


class Interleaved:
    """What lies beside events waits for those of its time, which their reader may hold back."""

    def __init__(self) -> None:
        self._waiting: list[tuple[int, Frame | ImuSamples]] = []

    def put(self, t_us: int, message: Frame | ImuSamples) -> Iterator[Frame | ImuSamples]:
        """Take a message whose time is t_us; gives those that waited too long."""
        insort(self._waiting, (t_us, message), key=lambda waiting: waiting[0])
        if len(self._waiting) > MOST_WAITING:
            yield self._waiting.pop(0)[1]

    def between(self, part: Events) -> Iterator[Message]:
        """The part, (n,) with n > 0, behind all that is of its time or earlier."""
        until_us = int(part["t"][-1])
        while self._waiting and self._waiting[0][0] <= until_us:
            yield self._waiting.pop(0)[1]
        yield part

    def rest(self) -> Iterator[Frame | ImuSamples]:
        """All that still waits."""
        while self._waiting:
            yield self._waiting.pop(0)[1]
