"""Link: messages that take their time from one end to the other, in order, and may get lost."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from evs.emulator.sensor.random import Term, indexed_normals, indexed_uniforms

T = TypeVar("T")

NEVER = -(2**62)
"""when the last message arrived where there was none, us"""


BLOCK = 256
"""numbers that are drawn together: one by one they cost 0.1 ms each"""


class LinkNoise:
    """Random numbers of one link, by the number of the message. Nothing is remembered but a cache.

    Those of Term.DROP are uniform in [0, 1), all others standard normal.
    """

    def __init__(self, seed: int, term: Term, link: int) -> None:
        self._source = (seed, term, link)
        self._draw = indexed_uniforms if term is Term.DROP else indexed_normals
        self._block = -1
        self._numbers = np.zeros(0)

    def __call__(self, number: int) -> float:
        """The number of message `number` >= 0."""
        block, place = divmod(number, BLOCK)
        if block != self._block:
            counters = np.arange(block * BLOCK, (block + 1) * BLOCK)
            self._block, self._numbers = block, self._draw(*self._source, counters)
        return float(self._numbers[place])


@dataclass(frozen=True)
class OnTheWay(Generic[T]):
    """A message between its two ends."""

    sent_us: int
    arrives_us: int
    message: T


@dataclass
class Link(Generic[T]):
    """One way from a sender to a receiver.

    Message n, sent at t, arrives at t + max(0, delay + jitter(n)), but never before one that was
    sent before it. What is lost on the way holds nobody up.
    """

    delay_us: int = 0
    jitter_us: float = 0.0
    """standard deviation"""
    jitter: LinkNoise | None = None
    """standard normal numbers; None: there is no jitter"""
    drop_share: float = 0.0
    drop: LinkNoise | None = None
    """uniform numbers; None: nothing is lost"""
    waiting: deque[OnTheWay[T]] = field(default_factory=deque)
    """in the order in which they were sent"""
    sent: int = 0
    """messages so far, the lost ones included"""
    dropped: int = 0
    """how many were lost"""
    last_us: int = NEVER
    """when the last one arrives"""

    def send(self, message: T, t_us: int) -> bool:
        """Put a message on its way; False: it got lost."""
        number = self.sent
        self.sent += 1
        if self.drop is not None and self.drop(number) < self.drop_share:
            self.dropped += 1
            return False
        late_us = self.delay_us
        if self.jitter is not None:
            late_us = max(0, late_us + round(self.jitter_us * self.jitter(number)))
        self.last_us = max(self.last_us, t_us + late_us)
        self.waiting.append(OnTheWay(t_us, self.last_us, message))
        return True

    def take(self, t_us: int) -> list[OnTheWay[T]]:
        """What has arrived by `t_us`, in the order in which it was sent."""
        found: list[OnTheWay[T]] = []
        while self.waiting and self.waiting[0].arrives_us <= t_us:
            found.append(self.waiting.popleft())
        return found
