"""Arrays of an NPZ archive in pieces: reading from front to end, spooling and writing."""

from __future__ import annotations

import math
import tempfile
import zipfile
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

Array = np.ndarray[Any, Any]

MAX_RATIO = 1100
"""deflate expands at most 1032 times; an array that states more is corrupt"""

PIECE_BYTES = 1 << 20

_IN_MEMORY_BYTES = 1 << 20
"""a larger spool is moved to the disk"""


class NotARecordingError(Exception):
    """The archive is valid, but not a recording. Never reaches users."""


class Archive(zipfile.ZipFile):
    """A ZIP archive of arrays; closing it closes its open arrays."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._columns: list[ArrayReader] = []

    def column(self, name: str, kinds: str, axes: int) -> ArrayReader:
        """Open an array at its first row. Errors as ArrayReader's."""
        info = self._info(name)
        member = self.open(info)
        try:
            made = ArrayReader(member, info, name, kinds, axes)
        except BaseException:
            member.close()
            raise
        self._columns.append(made)
        return made

    def close(self) -> None:
        """Close the open arrays and the file."""
        for column in getattr(self, "_columns", []):
            column.close()
        super().close()

    def _info(self, name: str) -> zipfile.ZipInfo:
        try:
            info = self.getinfo(f"{name}.npy")
        except KeyError:
            raise NotARecordingError(f"it has no array '{name}'; it needs t, x, y, p") from None
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise NotARecordingError(f"array '{name}' is compressed in another way than numpy does")
        if info.file_size > MAX_RATIO * (info.compress_size + 64):
            raise NotARecordingError(
                f"array '{name}' states {info.file_size} bytes, which cannot be in it"
            )
        return info


class ArrayReader:
    """Reads an array of an archive row by row, without allocating all of it.

    NotARecordingError where it is missing or of another kind. The archive's checksum is compared
    when the last row is read.
    """

    def __init__(
        self, member: IO[bytes], info: zipfile.ZipInfo, name: str, kinds: str, axes: int
    ) -> None:
        """Read the array's header; `kinds` and `axes` are the allowed dtype kinds and axes."""
        self.is_compressed = info.compress_type != zipfile.ZIP_STORED
        self._member = member
        version = np.lib.format.read_magic(self._member)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(self._member)
        else:
            shape, _, dtype = np.lib.format.read_array_header_2_0(self._member)
        if dtype.kind not in kinds or len(shape) != axes:
            raise NotARecordingError(f"array '{name}' is {dtype} of shape {shape}")
        if math.prod(shape) * dtype.itemsize != info.file_size - self._member.tell():
            raise NotARecordingError(f"array '{name}' is not of the size that it states")
        self.dtype, self.shape = dtype, shape
        self.left = shape[0] if shape else 1
        """rows not read yet"""
        self.row_bytes = dtype.itemsize * math.prod(shape[1:])

    def read(self, rows: int) -> Array:
        """Read the next rows; fewer at the end."""
        count = min(rows, self.left)
        data = self._member.read(count * self.row_bytes)
        self.left -= count
        if not self.left and self._member.read(1):
            raise NotARecordingError("an array is followed by something else")
        return np.frombuffer(data, self.dtype).reshape((count, *self.shape[1:]))

    def close(self) -> None:
        """Close it."""
        self._member.close()

    def all(self) -> Array:
        """Read all rows that are left; a scalar for an array without axes."""
        whole = self.read(self.left)
        return whole.reshape(self.shape) if not self.shape else whole


class ArraySpool:
    """An array that grows row by row, in memory while it is small, then in a temporary file."""

    def __init__(self, folder: Path, dtype: Any, shape: tuple[int, ...] = ()) -> None:
        """Start empty; `folder` is where a file would be, dtype and shape are a row's."""
        self.dtype, self.shape = np.dtype(dtype), shape
        spooled = tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY_BYTES, dir=str(folder))  # noqa: SIM115
        self._file = cast(IO[bytes], spooled)

    def append(self, rows: Array) -> None:
        """Append a copy of rows, (n, *shape). OSError: the disk is full."""
        self._file.write(np.ascontiguousarray(rows, self.dtype).tobytes())

    def write_to(self, archive: zipfile.ZipFile, name: str, rows: int) -> None:
        """Write the first `rows` rows as an array of an archive."""
        with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
            header = {
                "descr": np.lib.format.dtype_to_descr(self.dtype),
                "fortran_order": False,
                "shape": (rows, *self.shape),
            }
            np.lib.format.write_array_header_1_0(member, header)
            left = rows * self.dtype.itemsize * math.prod(self.shape)
            self._file.seek(0)
            while left:
                piece = self._file.read(min(left, PIECE_BYTES))
                member.write(piece)
                left -= len(piece)

    def close(self) -> None:
        """Close it."""
        self._file.close()


def write_array(archive: zipfile.ZipFile, name: str, values: Array) -> None:
    """Write a whole array into an archive, as numpy.savez does."""
    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array(member, values, allow_pickle=False)
