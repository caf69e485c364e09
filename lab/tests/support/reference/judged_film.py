"""Films whose events are compared with those of converged light."""

from __future__ import annotations

from evs.msgs import Events
from evs_lab.metrics import Comparison, compare
from reference.film import TICK_US, Film


class JudgedFilm(Film):
    """A film whose event streams are compared."""

    def compare(self, events: Events, truth: Events, begin_us: int = 0) -> Comparison:
        """Compare two event streams of this film from `begin_us` on."""
        end_us = TICK_US * (self.ticks - 1)
        return compare(events, truth, self.width, self.height, begin_us, end_us)
