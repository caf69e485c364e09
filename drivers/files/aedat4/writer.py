"""Aedat4Writer: writes one AEDAT4 file that is valid for every reader at any moment."""

from __future__ import annotations

import hashlib
import os
from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import FileIO
from pathlib import Path

import numpy as np

from evs.drivers.files.aedat4 import compression as compressions
from evs.drivers.files.aedat4 import layout

MAX_TABLE_PACKETS = 1 << 20
"""A longer file gets no data table, which readers then build themselves: bounds memory."""


class Aedat4Writer:
    """One file, written packet by packet, unbuffered: a packet is with the system on return.

    A file without its data table (killed before close) is whole for every reader; the table at
    the end only lets dv-processing seek without a first pass.

    The table and the header's pointer to it cannot be written at one instant. A reader that finds
    no pointer takes the table for a packet, and must then take it for a torn one. Half of all
    compressed tables look like that by chance, so padding is tried; an uncompressed one never does,
    so `none` has no table.
    """

    def __init__(self, path: Path, xml: str, compression: str, *, new: bool = False) -> None:
        """Create the file and write its header.

        In: new, the file must not be there yet; else it is replaced. OSError: no place to write.
        """
        self.path = path
        self.packets = 0
        self.bytes = 0
        """size of the file so far"""
        self._compressed = compression != "none"
        self._compress: Callable[[bytes], bytes] = compressions.compressor(compression)
        self._table = array("q")
        header = layout.io_header(compressions.NUMBERS[compression], xml)
        pointer_at = layout.parse_io_header(header).table_position_at
        self._pointer_at = len(layout.MAGIC) + (pointer_at or 0)
        self._file = FileIO(path, "x" if new else "w")
        try:
            self._append(layout.MAGIC + header)
        except OSError:
            self._file.close()
            if new:
                with suppress(OSError):
                    path.unlink()
            raise

    def append(self, stream: int, body: bytes, elements: int, span_us: tuple[int, int]) -> None:
        """Append one packet: its (compressed) body, and what the data table says of it.

        OSError where the disk does not take it; the file is then as it was before.
        """
        offset = self.bytes + layout.PACKET_HEADER.size
        self._append(layout.PACKET_HEADER.pack(stream, len(body)), body)
        self.packets += 1
        if self.packets <= MAX_TABLE_PACKETS:
            self._table.extend((stream, offset, len(body), elements, *span_us))

    def close(self, table: bool = True) -> bool:
        """Append the data table, unless told not to, and let go of the file; whether it has one.

        Never raises for a disk that is full.
        """
        if self._file.closed:
            return False
        wanted = table and self._compressed and 0 < self.packets <= MAX_TABLE_PACKETS
        has_table = wanted and self._write_table()
        self._file.close()
        return has_table

    def _write_table(self) -> bool:
        rows = np.frombuffer(self._table, np.int64).reshape(-1, 1 + layout.TABLE_COLUMNS)
        for padding in _paddings():
            table = self._compress(layout.data_table(rows[:, 0], rows[:, 1:], padding))
            if _looks_torn(table):
                break
        else:
            return False
        position = self.bytes
        try:
            self._append(table)
        except OSError:
            # no room for the table: the recording is whole without it
            return False
        # the header points to the table only once it is there
        os.pwrite(self._file.fileno(), position.to_bytes(8, "little"), self._pointer_at)
        return True

    def _append(self, *parts: bytes) -> None:
        """Hand all bytes to the system, or leave the file unchanged and raise OSError."""
        size = sum(map(len, parts))
        try:
            # one call, and no copy of the parts side by side
            done = os.writev(self._file.fileno(), parts)
            if done < size:
                rest = memoryview(b"".join(parts))[done:]
                while rest:
                    rest = rest[self._file.write(rest) :]
        except OSError:
            with suppress(OSError):  # a device has no tail to cut
                os.ftruncate(self._file.fileno(), self.bytes)
                os.lseek(self._file.fileno(), self.bytes, os.SEEK_SET)
            raise
        self.bytes += size


def _looks_torn(table: bytes) -> bool:
    """Whether these bytes, taken for a packet, state a size that runs past their end."""
    header = layout.PACKET_HEADER.size
    size: int = layout.PACKET_HEADER.unpack_from(table)[1]
    return size > len(table) - header


def _paddings() -> Iterator[bytes]:
    """Paddings for a table, of which a few are enough to change how its frame begins."""
    # bytes 4-7 of a frame hold the low bits of its first block's size, or (a large ZSTD frame) the
    # third byte of its content's; noise changes the first where all else is compressible, zeros
    # where nothing is, and 8 MiB of zeros change the last
    for more in (0, 1 << 23):
        for step in range(0, 16 * 1096, 1096):
            yield hashlib.shake_128().digest(step) + bytes(step + more)
