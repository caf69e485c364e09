"""When the rows of intensity frames are read: events of a DAVIS's pixels follow from it.

Before an exposure each row is read once for its reset level, and after it once for its signal.
core/sensor/aps_crosstalk.h has what a read does to the event pixels of its row.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from evs.emulator.base.stamps import first_from, stamp_us
from evs.emulator.sensor.parameters import ApsParameters

I32 = npt.NDArray[np.int32]


class RowReads:
    """The reads of the rows of all frames."""

    def __init__(self, parameters: ApsParameters, rows: int) -> None:
        """Place the reads of one frame.

        Args:
            parameters: [sensor.aps], resolved.
            rows: Of the sensor.
        """
        self._rate_hz = parameters.rate_hz
        numbers = np.arange(rows)
        # a rolling shutter resets a row when its exposure begins, a global one all before it
        early = 0 if parameters.shutter == "rolling" else rows
        reset = [parameters.read_us(row - early) for row in range(rows)]
        signal = [
            parameters.exposure_us + parameters.read_us(row + 1 if early else row)
            for row in range(rows)
        ]
        # (2 rows,) us after the frame's begin, by time, rows in order
        after = np.array([*reset, *signal], np.int64)
        order = np.argsort(after, kind="stable")
        self._after_us = after[order]
        self._rows = np.concatenate([numbers, numbers])[order]

    def within(self, t_begin_us: int, t_end_us: int) -> I32:
        """The reads of a tick.

        Args:
            t_begin_us: Where the tick begins, us.
            t_end_us: Where it ends, us.

        Returns:
            (n, 2) int32, by time: the row, and us after the beginning of the tick, 1 ... tick.
        """
        first = first_from(t_begin_us - int(self._after_us[-1]), self._rate_hz)
        found = []
        while (begin_us := stamp_us(first, self._rate_hz)) + self._after_us[0] <= t_end_us:
            low, high = np.searchsorted(
                self._after_us, [t_begin_us - begin_us, t_end_us - begin_us], "right"
            )
            offsets = self._after_us[low:high] + (begin_us - t_begin_us)
            found.append(np.stack([self._rows[low:high], offsets], axis=1))
            first += 1
        reads = np.concatenate(found) if found else np.zeros((0, 2))
        # frames of a rolling shutter overlap
        order = np.argsort(reads[:, 1], kind="stable")
        return np.ascontiguousarray(reads[order], np.int32)
