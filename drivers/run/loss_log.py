"""The gaps of a live stream: what was sent and did not arrive, as intervals of simulated time."""

from __future__ import annotations

from dataclasses import dataclass

from evs.drivers.bus import Subscription
from evs.msgs import EventPacket

MOST_GAPS = 1000
"""Gaps that are kept one by one; lost packets are counted beyond that, too."""


@dataclass(frozen=True)
class Gap:
    """An interval of the camera's time of which nothing arrived."""

    begin_us: int
    end_us: int
    packets: int

    def __str__(self) -> str:
        span = f"{self.begin_us / 1e6:.6f} s and {self.end_us / 1e6:.6f} s"
        return f"{self.packets:,} between {span}"


class LossLog:
    """Watches a subscription to one camera from which others receive."""

    def __init__(self, stream: Subscription) -> None:
        self.gaps: list[Gap] = []
        """The first MOST_GAPS."""
        self._stream = stream
        self._lost = 0
        self._end_us = 0
        """time at the end of the last packet"""

    def update(self, packet: EventPacket | None) -> None:
        """Count losses after each receive.

        Args:
            packet: What was received; None: nothing, but perhaps a status came.
        """
        lost, self._lost = self._stream.lost - self._lost, self._stream.lost
        if lost > 0:
            if packet is not None:
                end_us = packet.time_base_us
            else:
                end_us = 0 if self._stream.status is None else self._stream.status.time_end_us
            self._add(Gap(self._end_us, max(self._end_us, end_us), lost))
        if packet is not None:
            self._end_us = packet.time_end_us

    def _add(self, gap: Gap) -> None:
        last = self.gaps[-1] if self.gaps else None
        if last is not None and last.begin_us == gap.begin_us:
            # a status has reported its beginning already
            self.gaps[-1] = Gap(last.begin_us, gap.end_us, last.packets + gap.packets)
        elif len(self.gaps) < MOST_GAPS:
            self.gaps.append(gap)
