"""Packets gathered into windows of one length: a picture of the pixels that fired, and rates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.msgs import EventPacket, Events

PERIOD_US = 20_000
"""Length of a window, simulated time: 50 pictures a second."""

NOTHING, OFF, ON = 0, 1, 2
"""Values of a pixel in a window's picture."""


@dataclass(frozen=True, eq=False)
class Window:
    """The events of (end_us - period_us, end_us]."""

    camera: str
    end_us: int
    """us of simulated time"""
    period_us: int
    picture: npt.NDArray[np.uint8]
    """(h, w): NOTHING, or OFF or ON by the pixel's last event"""
    on: int
    """ON events"""
    off: int

    @property
    def on_hz(self) -> float:
        """ON events per simulated second."""
        return 1e6 * self.on / self.period_us

    @property
    def off_hz(self) -> float:
        """OFF events per simulated second."""
        return 1e6 * self.off / self.period_us


class WindowBuilder:
    """Gathers one camera's packets into windows, each given out as soon as its time has passed."""

    def __init__(self, camera: str, width: int, height: int, period_us: int = PERIOD_US) -> None:
        self._camera, self._period_us = camera, period_us
        self._size = height, width
        self._end_us: int | None = None
        self._clear()

    def add(self, packet: EventPacket) -> Iterator[Window]:
        """Add a packet; yield the windows that end no later than it does, also empty ones.

        A step back in time (a new run) starts over, and a jump of more than a second omits the
        empty windows in it.
        """
        begin_us = packet.time_base_us
        if self._end_us is None or begin_us < self._end_us - self._period_us:
            self._clear()
            self._end_us = self._after(begin_us)
        elif begin_us > self._end_us + 1_000_000:
            yield self._window()
            self._end_us = self._after(begin_us)
        events = packet.events
        while packet.time_end_us >= self._end_us:
            count = int(np.searchsorted(events["t"], self._end_us, side="right"))
            self._take(events[:count])
            events = events[count:]
            yield self._window()
            self._end_us += self._period_us
        self._take(events)

    def restart(self) -> None:
        """Forget what was gathered: packets were left out."""
        if self._end_us is not None:
            self._clear()
            self._end_us = None

    def rest(self) -> Iterator[Window]:
        """Yield the last window, which is incomplete, if it has any event."""
        if self._on + self._off:
            yield self._window()

    def _after(self, t_us: int) -> int:
        return (t_us // self._period_us + 1) * self._period_us

    def _take(self, events: Events) -> None:
        # of several events of a pixel numpy keeps the last
        self._picture[events["y"], events["x"]] = OFF + events["p"].astype(np.uint8)
        on = int(np.count_nonzero(events["p"]))
        self._on += on
        self._off += len(events) - on

    def _window(self) -> Window:
        assert self._end_us is not None
        found = Window(
            self._camera, self._end_us, self._period_us, self._picture, self._on, self._off
        )
        self._clear()
        return found

    def _clear(self) -> None:
        self._picture = np.zeros(self._size, np.uint8)
        self._on = self._off = 0
