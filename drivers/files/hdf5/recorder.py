"""Recorders of HDF5 files: DSEC's layout and Metavision's.

DSEC's:
events/t      (n,) int64 us after t_offset (DSEC: uint32, which ends after 71 minutes)
events/x, y   (n,) uint16 px; events/p (n,) uint8, 1 ON, 0 OFF
ms_to_idx     (m,) uint64: the first event at or after each ms, counted from t_offset
t_offset      int64 us

Metavision's:
CD/events     (n,) compound of x, y, p, t, in chunks that are encoded with ECF
CD/indexes    (m,) compound of id, ts: the first event of the last 2 ms that had any, and its t
              after the first event's; before the first event 0, -1. Attribute offset: minus t of
              the first event
EXT_TRIGGER/events, indexes   (0,): the same of external triggers, which are not written

Both:
evs_stream    the StreamInfo as JSON
evs_whole     int64: so many events are whole in every column

The file is in HDF5's mode of one writer and many readers (SWMR) while it is open: what was flushed
can be read at any time, and after a kill.
"""

from __future__ import annotations

import dataclasses
import json
import zlib
from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.formats import AnyPath
from evs.drivers.files.hdf5.library import ECF_FILTER, load
from evs.drivers.files.library_recorder import LibraryRecorder
from evs.msgs import EventPacket, Events, EvsError, join_events
from evs.msgs.codecs.ecf import encode_ecf

COLUMNS = {"t": "<i8", "x": "<u2", "y": "<u2", "p": "u1"}
STREAM, WHOLE = "evs_stream", "evs_whole"
LONGEST_US = 1 << 37
"""longest recording, 38 hours: each ms, or every second one, has an entry in the index"""

METAVISION = "CD/events"
"""the data set of events in Metavision's layout"""

CD_DTYPE = np.dtype(
    {"names": list("xypt"), "formats": ["<u2", "<u2", "<i2", "<i8"], "offsets": [0, 2, 4, 8]}
)
TRIGGER_DTYPE = np.dtype(
    {"names": ["p", "t", "id"], "formats": ["<i2", "<i8", "<i2"], "offsets": [0, 8, 16]},
    align=True,
)
INDEX_DTYPE = np.dtype([("id", "<u8"), ("ts", "<i8")])

SECTORS = {"alignment_threshold": 1, "alignment_interval": 512, "meta_block_size": 1}
"""each block begins with a sector of the disk: a power cut between two sectors then tears no header
that is written again, whose checksum would make the whole file unreadable"""

Entries = np.ndarray[Any, Any]


def write_index(one: Any, begin: int, end: int, entries: Callable[[Entries], Entries]) -> None:
    """Append to an index whose entries never fall; a long pause takes little space and time.

    Chunks with the same entry throughout are compressed once and written as they are.

    Args:
        one: Data set of `begin` entries, plain or compressed with deflate.
        begin: Its length.
        end: Its length afterwards.
        entries: The entries, (n,), at some places, (n,) int64.
    """
    chunk = one.chunks[0]
    one.resize((end,))
    inner = np.arange(-(-begin // chunk) * chunk, end, chunk)
    edges = np.unique(np.concatenate([[begin], inner, [end]]))
    firsts, lasts = edges[:-1], edges[1:] - 1
    same = (entries(firsts) == entries(lasts)) & (lasts - firsts == chunk - 1)
    done: dict[bytes, bytes] = {}
    for first, last, is_one in zip(firsts.tolist(), lasts.tolist(), same.tolist(), strict=True):
        if not is_one:
            one[first : last + 1] = entries(np.arange(first, last + 1))
            continue
        entry = entries(np.array([first])).tobytes()
        if entry not in done:
            plain = np.frombuffer(entry * chunk, np.uint8).reshape(chunk, -1)
            data = (plain.T if one.shuffle else plain).tobytes()
            done = {entry: zlib.compress(data, 1) if one.compression else data}
        one.id.write_direct_chunk((first,), done[entry])


class _Hdf5Recorder(LibraryRecorder):
    """The base: events wait until a chunk of them is there, or until they are flushed."""

    # the last chunk is compressed again each time
    FLUSH_PERIOD_US = 10_000_000
    LIBRARY_ERRORS = (OSError, RuntimeError, ValueError)
    CHUNK: int
    """events that are compressed together"""

    def __init__(self, path: AnyPath) -> None:
        super().__init__(path)
        self._h5py = load()
        self._file: Any = None
        self._whole: Any = None
        self._parts: list[Events] = []
        self._waiting = 0
        self._length = 0
        self._first_us: int | None = None

    @abstractmethod
    def _create_sets(self) -> None:
        """Create the data sets and attributes of the layout."""

    @abstractmethod
    def _begin(self, first_us: int) -> None:
        """Write what follows from the time of the first event."""

    @abstractmethod
    def _append(self, events: Events) -> None:
        """Write events, (n,) with n > 0, after the first `_length`, and their index."""

    def _create(self, path: Path) -> None:
        self._file = self._h5py.File(path, "w", libver=("v110", "v110"), **SECTORS)
        stream_text = json.dumps(dataclasses.asdict(self.stream), default=str)
        self._file.create_dataset(STREAM, data=stream_text)
        self._whole = self._file.create_dataset(WHOLE, data=np.int64(0))
        self._create_sets()

    def _check(self, events: Events) -> None:
        super()._check(events)
        last = int(events["t"][-1])
        base = int(events["t"][0]) if self._first_us is None else self._first_us
        if last - base >= LONGEST_US:
            raise EvsError(
                f"cannot record from {base} us on to {last} us to {self._path}: HDF5 holds "
                f"{LONGEST_US} us; record to .aedat4"
            )

    def _write_packet(self, packet: EventPacket) -> None:
        if self._first_us is None:
            self._first_us = int(packet.events["t"][0])
            self._begin(self._first_us)
        self._parts.append(packet.events.copy())
        self._waiting += len(packet.events)
        if self._waiting >= self.CHUNK:
            self._put(self._waiting // self.CHUNK * self.CHUNK)
            self._commit(self._length)

    def _sync(self) -> None:
        self._put(self._waiting)
        self._commit(self._length)

    def _commit(self, count: int) -> None:
        """Flush all rows, then the number of rows."""
        self._file.flush()
        self._whole[()] = count
        self._file.flush()

    def _put(self, count: int) -> None:
        """Write the first `count` waiting events."""
        if not count:
            return
        waiting = join_events(self._parts)
        events, rest = waiting[:count], waiting[count:].copy()
        self._parts, self._waiting = [rest], len(rest)
        self.meter.lap("pack")
        self._append(events)
        self._length += count

    def _finish(self) -> None:
        try:
            self._put(self._waiting)
            self._end_index()
            self._commit(self._length)
        finally:
            self._file.close()

    def _end_index(self) -> None:
        """Write what the index lacks at the end of the recording."""


class Hdf5Recorder(_Hdf5Recorder):
    """A Sink that writes DSEC's layout; compressed as every HDF5 library reads it (deflate)."""

    NAME = "hdf5"
    CHUNK = 1 << 16

    def _create_sets(self) -> None:
        kinds: dict[str, Any] = {"maxshape": (None,), "compression": 1, "shuffle": True}
        self._columns = {
            name: self._file.create_dataset(
                f"events/{name}", (0,), dtype, chunks=(self.CHUNK,), **kinds
            )
            for name, dtype in COLUMNS.items()
        }
        self._index = self._file.create_dataset(
            "ms_to_idx", (0,), "<u8", chunks=(1 << 14,), **kinds
        )
        self._file.attrs["sensor_resolution"] = (self.stream.height, self.stream.width)
        self._offset = self._file.create_dataset("t_offset", data=np.int64(0))
        self._file.swmr_mode = True

    def _begin(self, first_us: int) -> None:
        self._offset_us = first_us // 1000 * 1000
        self._offset[()] = self._offset_us

    def _append(self, events: Events) -> None:
        t = events["t"] - self._offset_us
        begin, end = self._length, self._length + len(events)
        for name, column in self._columns.items():
            column.resize((end,))
            column[begin:end] = t if name == "t" else events[name]
        # ms that begin up to the last event; those before are indexed
        known, upto = len(self._index), int(t[-1]) // 1000 + 1
        if known < upto:

            def entries(ms: Entries) -> Entries:
                return (begin + np.searchsorted(t, ms * 1000)).astype("<u8")

            write_index(self._index, known, upto, entries)


class MetavisionRecorder(_Hdf5Recorder):
    """A Sink that writes Metavision's layout, as OpenEB's own recorder does."""

    NAME = "metavision"
    CHUNK = 1 << 14
    """OpenEB's"""

    INDEX_US = 2000

    LONGEST_PAUSE_US = 7_200_000_000
    """58 MB of index"""

    def _check(self, events: Events) -> None:
        super()._check(events)
        before_us = int(events["t"][0]) if self._first_us is None else self._last_us
        pause_us = int(np.diff(events["t"], prepend=before_us).max())
        if pause_us > self.LONGEST_PAUSE_US:
            size = pause_us // self.INDEX_US * INDEX_DTYPE.itemsize
            raise EvsError(
                f"cannot record a pause of {pause_us * 1e-6:.0f} s to {self._path}: its index, "
                f"an entry every 2 ms, would take {size / 1e6:.0f} MB; record to .h5 or .aedat4"
            )

    def _create_sets(self) -> None:
        kinds: dict[str, Any] = {"maxshape": (None,), "chunks": (self.CHUNK,)}
        # HDF5 itself need not know the codec: chunks are written as they are
        codec = {"compression": ECF_FILTER, "allow_unknown_filter": True}
        self._events_set = self._file.create_dataset(METAVISION, (0,), CD_DTYPE, **kinds, **codec)
        # OpenEB reads its chunks as they lie in the file, so that they cannot be compressed
        self._index = self._file.create_dataset("CD/indexes", (0,), INDEX_DTYPE, **kinds)
        self._file.create_dataset("EXT_TRIGGER/events", (0,), TRIGGER_DTYPE, **kinds)
        self._file.create_dataset("EXT_TRIGGER/indexes", (0,), INDEX_DTYPE, **kinds)
        size = f"{self.stream.width}x{self.stream.height}"
        for name, text in (("version", "1.0"), ("geometry", size), ("integrator_name", "evs")):
            self._state(self._file, name, text)
        # entries of the index, and the one to come: of the last 2 ms that had events
        self._entries, self._next_id, self._next_us = 0, 0, -1

    def _begin(self, first_us: int) -> None:
        self._state(self._index, "offset", str(-first_us))
        self._file.flush()
        # attributes cannot be added later
        self._file.swmr_mode = True

    def _state(self, one: Any, name: str, text: str) -> None:
        """Create an attribute as OpenEB reads it: ASCII, of variable length."""
        one.attrs.create(name, text, dtype=self._h5py.string_dtype("ascii"))

    def _sync(self) -> None:
        """Write the last chunk as far as it is; its events still wait for the rest of it."""
        if self._waiting:
            self._write_chunk(self._length, join_events(self._parts))
        self._commit(self._length + self._waiting)

    def _write_chunk(self, begin: int, events: Events) -> None:
        self._events_set.resize((begin + len(events),))
        self._events_set.id.write_direct_chunk((begin,), encode_ecf(events))

    def _append(self, events: Events) -> None:
        for begin in range(0, len(events), self.CHUNK):
            self._write_chunk(self._length + begin, events[begin : begin + self.CHUNK])
        t = events["t"] - (self._first_us or 0)
        slots = t // self.INDEX_US
        firsts = np.flatnonzero(np.diff(slots, prepend=self._entries - 1))
        if not len(firsts):
            return
        # up to the slot of each of these events, entries are of the one before it
        ids = np.append(self._next_id, self._length + firsts)
        times_us = np.append(self._next_us, t[firsts])
        upto = slots[firsts] + 1
        self._grow_index(ids, times_us, upto)
        self._next_id, self._next_us = int(ids[-1]), int(times_us[-1])

    def _end_index(self) -> None:
        if self._first_us is not None:
            ids, times_us = np.array([self._next_id]), np.array([self._next_us])
            self._grow_index(ids, times_us, np.array([self._entries + 1]))

    def _grow_index(self, ids: Any, times_us: Any, upto: Any) -> None:
        """Append entries of `ids[k]`, `times_us[k]` until there are `upto[k]`, k by k."""
        end = int(upto[-1])

        def entries(places: Entries) -> Entries:
            found = np.searchsorted(upto, places, side="right")
            made = np.zeros(len(places), INDEX_DTYPE)
            made["id"], made["ts"] = ids[found], times_us[found]
            return made

        write_index(self._index, self._entries, end, entries)
        self._entries = end
