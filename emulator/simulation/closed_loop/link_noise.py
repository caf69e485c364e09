"""Chance: a number for each message, from (seed, term, link, number of the message) alone."""

from __future__ import annotations

import numpy as np

from evs.emulator.sensor.random import Term, indexed_normals, indexed_uniforms

BLOCK = 256
"""numbers that are drawn together: one by one they cost 0.1 ms each"""


class Chance:
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
