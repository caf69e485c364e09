"""The line of statistics that event camera drivers print every few seconds."""

from __future__ import annotations

import sys
from collections.abc import Callable

from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError


def to_stderr(line: str) -> None:
    """Write one line, also while a progress bar is drawn."""
    sys.stderr.write(line + "\n")


class Statistics:
    """Counts of one camera since its last line; "in" counts 16 bytes for each event."""

    def __init__(
        self,
        node: str,
        interval_s: float,
        log: Callable[[str], None] = to_stderr,
        clock: Callable[[], float] = monotonic_s,
    ) -> None:
        """Start with no packets.

        Args:
            node: Name of the node, such as /camera.
            interval_s: Wall-clock time between lines, s; 0: no lines.
            log: Receives each line.
            clock: The wall clock, s.

        Raises:
            EvsError: The interval is negative or too long.
        """
        if not 0 <= interval_s <= 1e9:
            raise EvsError(
                f"statistics_print_interval is {interval_s:g}: give the seconds, 0 for no lines"
            )
        self._logger = node.strip("/").replace("/", ".")
        self._interval_s, self._log, self._clock = interval_s, log, clock
        self._begin_s: float | None = None
        self._bytes = self._packets = self._sent = self._dropped = 0

    def add(self, t_us: int, size: int, sent: int, dropped: int) -> None:
        """Count one packet, and log the line if it is due.

        Args:
            t_us: End of the packet, us.
            size: Its size, bytes.
            sent: Event messages sent since the start.
            dropped: Event messages dropped since the start.
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
        self._log(
            f"[INFO] [{seconds}.{rest_us:06d}000] [{self._logger}]: "
            f"bw in: {1e-6 * self._bytes / elapsed_s:9.5f} MB/s, "
            f"msgs/s in: {self._packets / elapsed_s:7.0f}, out: {out / elapsed_s:7.0f}"
            + (f", dropped: {lost}" if lost else "")
        )
        self._begin_s += elapsed_s
        self._bytes = self._packets = 0
        self._sent, self._dropped = sent, dropped
