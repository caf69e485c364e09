"""Hdf5Recorder: one camera's packets in DSEC's layout.

events/t      (n,) int64 us after t_offset (DSEC: uint32, which ends after 71 minutes)
events/x, y   (n,) uint16 px; events/p (n,) uint8, 1 ON, 0 OFF
ms_to_idx     (m,) uint64: the first event at or after each ms, counted from t_offset
t_offset      int64 us
evs_stream    the StreamInfo as JSON; attribute sensor_resolution: height, width
evs_whole     int64: so many events are whole in every column

The file is in HDF5's mode of one writer and many readers (SWMR) while it is open: what was flushed
can be read at any time, and after a kill.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.formats import AnyPath
from evs.drivers.files.hdf5.library import load
from evs.drivers.files.library_recorder import LibraryRecorder
from evs.msgs import EventPacket, Events, EvsError, join_events

COLUMNS = {"t": "<i8", "x": "<u2", "y": "<u2", "p": "u1"}
STREAM, WHOLE = "evs_stream", "evs_whole"
LONGEST_US = 1 << 37
"""longest recording, 38 hours: each ms has an entry in the index"""

_CHUNK = 1 << 16
"""events that are compressed together"""


class Hdf5Recorder(LibraryRecorder):
    """A Sink that writes DSEC's layout; compressed as every HDF5 library reads it (deflate)."""

    NAME = "hdf5"
    # a column's last chunk is compressed again each time
    FLUSH_PERIOD_US = 10_000_000
    LIBRARY_ERRORS = (OSError, RuntimeError, ValueError)

    def __init__(self, path: AnyPath) -> None:
        super().__init__(path)
        self._h5py = load()
        self._file: Any = None
        self._columns: dict[str, Any] = {}
        self._index: Any = None
        self._numbers: dict[str, Any] = {}
        self._parts: list[Events] = []
        self._waiting = 0
        self._length = 0
        self._offset_us: int | None = None

    def _create(self, path: Path) -> None:
        self._file = self._h5py.File(path, "w", libver=("v110", "v110"))
        kinds: dict[str, Any] = {"maxshape": (None,), "compression": 1, "shuffle": True}
        for name, dtype in COLUMNS.items():
            self._columns[name] = self._file.create_dataset(
                f"events/{name}", (0,), dtype, chunks=(_CHUNK,), **kinds
            )
        self._index = self._file.create_dataset("ms_to_idx", (0,), "<u8", chunks=(4096,), **kinds)
        stream_text = json.dumps(dataclasses.asdict(self.stream), default=str)
        self._file.create_dataset(STREAM, data=stream_text)
        self._file.attrs["sensor_resolution"] = (self.stream.height, self.stream.width)
        for name in ("t_offset", WHOLE):
            self._numbers[name] = self._file.create_dataset(name, data=np.int64(0))
        self._file.swmr_mode = True

    def _check(self, events: Events) -> None:
        super()._check(events)
        last = int(events["t"][-1])
        base = int(events["t"][0]) if self._offset_us is None else self._offset_us
        if last - base >= LONGEST_US:
            raise EvsError(
                f"cannot record from {base} us on to {last} us to {self._path}: HDF5 holds "
                f"{LONGEST_US} us; record to .aedat4"
            )

    def _write_packet(self, packet: EventPacket) -> None:
        if self._offset_us is None:
            self._offset_us = int(packet.events["t"][0]) // 1000 * 1000
            self._numbers["t_offset"][()] = self._offset_us
        self._parts.append(packet.events.copy())
        self._waiting += len(packet.events)
        if self._waiting >= _CHUNK:
            self._put(self._waiting // _CHUNK * _CHUNK)
            self._commit()

    def _sync(self) -> None:
        self._put(self._waiting)
        self._commit()

    def _commit(self) -> None:
        """Flush all rows, then the number of rows."""
        self._file.flush()
        self._numbers[WHOLE][()] = self._length
        self._file.flush()

    def _put(self, count: int) -> None:
        """Write the first `count` waiting events, and the index of the ms that begin in them."""
        if not count:
            return
        waiting = join_events(self._parts)
        events, rest = waiting[:count], waiting[count:].copy()
        self._parts, self._waiting = [rest], len(rest)
        self.meter.lap("pack")
        t = events["t"] - (self._offset_us or 0)
        begin, end = self._length, self._length + len(events)
        for name, column in self._columns.items():
            column.resize((end,))
            column[begin:end] = t if name == "t" else events[name]
        # ms that begin up to the last event; those before are indexed
        known = len(self._index)
        upto = int(t[-1]) // 1000 + 1
        self._index.resize((upto,))
        for first in range(known, upto, 1 << 20):
            ms = np.arange(first, min(upto, first + (1 << 20)))
            found = begin + np.searchsorted(t, ms * 1000)
            self._index[first : first + len(ms)] = found.astype(np.uint64)
        self._length = end

    def _finish(self) -> None:
        try:
            self._sync()
        finally:
            self._file.close()
