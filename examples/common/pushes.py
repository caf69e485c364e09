"""PushSchedule: when a loop is pushed; each push depends on the seed and its number alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PushSchedule:
    """One push after the other, all alike in time."""

    first_tick: int
    every_ticks: int
    ticks: int = 10
    """how long each lasts, ticks of 1 ms"""

    @property
    def seconds(self) -> float:
        """How long each lasts, s."""
        return self.ticks * 1e-3

    def random(self, tick: int, seed: int) -> np.random.Generator | None:
        """The numbers of the push that acts in the tick after `tick`; None: none does.

        The same in each of its ticks, so a loop that was restored goes on with the same.
        """
        number, since = divmod(tick - self.first_tick, self.every_ticks)
        if number < 0 or since >= self.ticks:
            return None
        return np.random.default_rng((seed % 2**64, number))
