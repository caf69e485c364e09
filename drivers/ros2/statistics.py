"""The line of statistics that event camera drivers print every few seconds."""

from __future__ import annotations

import sys
from collections.abc import Callable

from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError


def to_stderr(line: str) -> None:
    """One line, also while a progress bar is drawn."""
    sys.stderr.write(line + "\n")


class Statistics:
    """Counts of one camera since its last line. "in" is what the camera gave, 16 bytes an event."""

    def __init__(
        self,
        node: str,
        interval_s: float,
        say: Callable[[str], None] = to_stderr,
        clock: Callable[[], float] = monotonic_s,
    ) -> None:
        """In: node, as in /camera; interval_s of the wall clock between lines, 0: none."""
        if not 0 <= interval_s <= 1e9:
            raise EvsError(
                f"statistics_print_interval is {interval_s:g}: give the seconds, 0 for no lines"
            )
        self._logger = node.strip("/").replace("/", ".")
        self._interval_s, self._say, self._clock = interval_s, say, clock
        self._begin_s: float | None = None
        self._bytes = self._packets = self._sent = self._dropped = 0

    def add(self, t_us: int, size: int, sent: int, dropped: int) -> None:
        """Count one packet of `size` bytes that ends at t_us; say the line if it is due.

        In: sent, dropped: messages of events since the start.
        """
        if not self._interval_s:
            return
        if self._begin_s is None:
            self._begin_s = self._clock()
        self._bytes += size
        self._packets += 1
        elapsed_s = self._clock() - self._begin_s
        if elapsed_s < self._interval_s:
            return
        out, lost = sent - self._sent, dropped - self._dropped
        seconds, rest_us = divmod(t_us, 1_000_000)
        self._say(
            f"[INFO] [{seconds}.{rest_us:06d}000] [{self._logger}]: "
            f"bw in: {1e-6 * self._bytes / elapsed_s:9.5f} MB/s, "
            f"msgs/s in: {self._packets / elapsed_s:7.0f}, out: {out / elapsed_s:7.0f}"
            + (f", dropped: {lost}" if lost else "")
        )
        self._begin_s += elapsed_s
        self._bytes = self._packets = 0
        self._sent, self._dropped = sent, dropped
