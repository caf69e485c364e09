"""Frames, IMU samples and triggers of a stream, put back between its events by their times."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator

from evs.msgs import Events, Frame, ImuSamples, Triggers

AuxiliaryMessage = Frame | ImuSamples | Triggers
Message = Events | AuxiliaryMessage

MAX_WAITING = 64
"""So many messages wait for the events of their time at most; a frame is large."""


class Interleaver:
    """What lies beside events waits for those of its time, which their reader may hold back."""

    def __init__(self, max_waiting: int = MAX_WAITING) -> None:
        self._max_waiting = max_waiting
        self._waiting: list[tuple[int, AuxiliaryMessage]] = []

    def put(self, t_us: int, message: AuxiliaryMessage) -> Iterator[AuxiliaryMessage]:
        """Take a message whose time is t_us; gives those that waited too long."""
        insort(self._waiting, (t_us, message), key=lambda waiting: waiting[0])
        if len(self._waiting) > self._max_waiting:
            yield self._waiting.pop(0)[1]

    def between(self, part: Events) -> Iterator[Message]:
        """The part, (n,) with n > 0, behind all that is of its time or earlier."""
        until_us = int(part["t"][-1])
        while self._waiting and self._waiting[0][0] <= until_us:
            yield self._waiting.pop(0)[1]
        yield part

    def flush(self) -> Iterator[AuxiliaryMessage]:
        """All that still waits."""
        while self._waiting:
            yield self._waiting.pop(0)[1]
