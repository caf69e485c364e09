"""Frames, IMU samples and triggers of a stream, merged with its events by time."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator

from evs.msgs import Events, Frame, ImuSamples, Triggers

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
