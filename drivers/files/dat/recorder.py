"""DatRecorder: one camera's packets into a DAT file, 8 bytes an event."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.dat.library import load
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.whole import WholeRecorder
from evs.msgs import EventPacket, Events, EvsError

WRAP_US = 1 << 32
"""Stamps have 32 bits; readers count on from one that is smaller than the last."""

_ROWS = np.dtype([("t", "=u8"), ("x", "=u2"), ("y", "=u2"), ("payload", "u1")])


class DatRecorder(WholeRecorder):
    """A Sink that writes DAT by faery. Nothing but the sensor's size is kept beside the events."""

    NAME = "dat"
    FAULTS = (OSError, RuntimeError)

    def __init__(self, path: AnyPath) -> None:
        super().__init__(path)
        self._faery = load()
        self._encoder: Any = None

    def _begin(self, path: Path) -> None:
        sides = self.stream.width, self.stream.height
        self._encoder = self._faery.dat.Encoder(path, "dat2", "cd", False, sides)
        self._encoder.__enter__()

    def _check(self, events: Events) -> None:
        """A reader sees a wrap only where the stamp falls: never at the begin, or a wrap later."""
        super()._check(events)
        gaps = np.diff(events["t"], prepend=max(0, self._last_us))
        if int(gaps.max()) >= WRAP_US:
            raise EvsError(
                f"cannot record nothing for {gaps.max()} us to {self._path}: DAT needs an event "
                "every 4294 s; record to .aedat4"
            )

    def _take(self, packet: EventPacket) -> None:
        rows = np.empty(len(packet.events), _ROWS)
        for ours, theirs in zip("txyp", _ROWS.names or (), strict=True):
            rows[theirs] = packet.events[ours]
        self.meter.lap("pack")
        self._encoder.write(rows)

    def _end(self) -> None:
        self._encoder.__exit__(None, None, None)
