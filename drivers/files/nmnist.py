"""N-MNIST's and N-Caltech101's files of ATIS events: 5 bytes an event, without a header. Read only.

    byte 0 x, byte 1 y (from the upper left), bytes 2 to 4: polarity (1 bit), time (23 bits, us)
    y = 240: no event, the time of what follows is 2^13 us later

Source: the authors' description of the data sets, and their reader.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.drivers.files.integrity import IntegrityReport
from evs.drivers.files.paths import existing
from evs.drivers.files.recording_file import EventOnlyFile
from evs.drivers.files.time_order import in_order
from evs.msgs import Events, EvsError, StreamInfo, make_events

EVENT_BYTES = 5
OVERFLOW_ROW, OVERFLOW_US = 240, 1 << 13
NMNIST_SIDE_PX = 34
ATIS_WIDTH_PX, ATIS_HEIGHT_PX = 304, 240
_PIECE_BYTES = EVENT_BYTES << 16


@dataclass
class NMnistFile(EventOnlyFile):
    """A file of N-MNIST or N-Caltech101.

    Its sensor is 34 x 34 px where that holds all events, else the whole ATIS.
    """

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> NMnistFile:
        """Open a file. EvsError: it cannot be read, or is too short for an event."""
        found = existing(path)
        size = found.stat().st_size
        if size < EVENT_BYTES:
            raise EvsError(f"{found} is no N-MNIST file: it has {size} bytes, an event has 5")
        opened = cls(found, StreamInfo(ATIS_WIDTH_PX, ATIS_HEIGHT_PX, sensor="atis"), size)
        try:
            most = max(
                int(piece[axis].max(initial=0)) for _, piece in opened._pieces() for axis in "xy"
            )
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror}") from None
        if most < NMNIST_SIDE_PX:
            opened.stream = dataclasses.replace(
                opened.stream, width=NMNIST_SIDE_PX, height=NMNIST_SIDE_PX
            )
        return opened

    def events(self) -> Iterator[Events]:
        """The events of each ms that has any."""
        integrity = IntegrityReport(noun="events")
        yield from in_order(self._pieces(), self.stream, integrity)
        integrity.torn_tail(self.size - self.size % EVENT_BYTES, self.size)
        self.integrity = integrity

    def _pieces(self) -> Iterator[tuple[npt.NDArray[np.int64], Events]]:
        """Byte offsets and events of each piece of the file, in the order recorded."""
        at = later_us = 0
        with self.path.open("rb") as file:
            while len(data := file.read(_PIECE_BYTES)) >= EVENT_BYTES:
                count = len(data) // EVENT_BYTES
                rows = np.frombuffer(data, np.uint8, count * EVENT_BYTES)
                x, y, high, middle, low = rows.reshape(-1, EVENT_BYTES).T.astype(np.int64)
                overflows = y == OVERFLOW_ROW
                t = (high & 127) << 16 | middle << 8 | low
                t += later_us + OVERFLOW_US * np.cumsum(overflows)
                later_us += OVERFLOW_US * int(np.count_nonzero(overflows))
                kept = np.flatnonzero(~overflows)
                self.position = at
                events = make_events(t[kept], x[kept], y[kept], high[kept] >> 7)
                yield at + EVENT_BYTES * kept, events
                at += len(data)
