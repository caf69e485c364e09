"""Arrays of an NPZ archive in pieces: reading from front to end, spooling and writing."""

from __future__ import annotations

import math
import tempfile
import zipfile
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from evs.drivers.files.layouts import states_too_much

Array = np.ndarray[Any, Any]

MAX_RATIO = 1100
"""deflate expands at most 1032 times; an array that states more is corrupt"""

PIECE_BYTES = 1 << 20

_IN_MEMORY_BYTES = 1 << 20
"""a larger spool is moved to the disk"""


class NotARecordingError(Exception):
    """The archive is valid, but not a recording. Never reaches users."""


class OtherKindError(NotARecordingError):
    """An array has another dtype or number of axes."""


class Archive(zipfile.ZipFile):
    """A ZIP archive of arrays; closing it closes its open arrays."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._columns: list[ArrayReader] = []
        # frames may be black; their stamps are counted
        members = [one for one in self.infolist() if one.filename != "frames.npy"]
        stated = sum(one.file_size for one in members)
        if states_too_much(stated, sum(one.compress_size for one in members)):
            raise NotARecordingError(f"its arrays state {stated} bytes, which cannot be in it")

    @property
    def arrays(self) -> tuple[str, ...]:
        """Names of the arrays."""
        names = (one.partition(".npy") for one in self.namelist())
        return tuple(name for name, ending, rest in names if ending and not rest)

    def column(self, name: str, kinds: str, axes: int | None) -> ArrayReader:
        """Open an array, of any number of axes if `axes` is None. Errors as ArrayReader's."""
        info = self._info(name)
        member = self.open(info)
        try:
            is_compressed = info.compress_type != zipfile.ZIP_STORED
            made = ArrayReader(member, info.file_size, name, kinds, axes, is_compressed)
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


class SingleArray:
    """An NPY file as an archive of one array, `events`."""

    arrays = ("events",)

    def __init__(self, path: Path) -> None:
        self._path = path
        self._files: list[IO[bytes]] = []

    def __enter__(self) -> SingleArray:
        return self

    def __exit__(self, *_: object) -> None:
        for file in self._files:
            file.close()

    def namelist(self) -> list[str]:
        """As an archive's."""
        return ["events.npy"]

    def column(self, name: str, kinds: str, axes: int | None) -> ArrayReader:
        """As an archive's."""
        if name not in self.arrays:
            raise NotARecordingError(f"it has no array '{name}'")
        file = self._path.open("rb")
        self._files.append(file)
        return ArrayReader(file, self._path.stat().st_size, name, kinds, axes)


Arrays = Archive | SingleArray


def open_archive(path: Path) -> Arrays:
    """Open an NPZ or an NPY file. Raises what zipfile raises, and NotARecordingError."""
    with path.open("rb") as file:
        is_array = file.read(6) == b"\x93NUMPY"
    return SingleArray(path) if is_array else Archive(path)


class ArrayReader:
    """Reads an array of an archive row by row, without allocating all of it.

    An array that lies column by column (Fortran's order) is read as a whole.

    NotARecordingError where it is missing or of another kind. The archive's checksum is compared
    when the last row is read.
    """

    def __init__(
        self,
        member: IO[bytes],
        size: int,
        name: str,
        kinds: str,
        axes: int | None,
        is_compressed: bool = False,
    ) -> None:
        """Read the array's header.

        Args:
            member: The array's bytes.
            size: Number of elements.
            name: Its name.
            kinds: Allowed kinds of dtype.
            axes: Allowed number of axes; None: any.
            is_compressed: Whether the archive compresses it.
        """
        self.is_compressed = is_compressed
        self._member = member
        version = np.lib.format.read_magic(self._member)
        if version == (1, 0):
            shape, by_columns, dtype = np.lib.format.read_array_header_1_0(self._member)
        else:
            shape, by_columns, dtype = np.lib.format.read_array_header_2_0(self._member)
        if dtype.kind not in kinds or dtype.hasobject or axes not in (None, len(shape)):
            raise OtherKindError(f"array '{name}' is {dtype} of shape {shape}")
        if math.prod(shape) * dtype.itemsize != size - self._member.tell():
            raise NotARecordingError(f"array '{name}' is not of the size that it states")
        self.dtype, self.shape = dtype, shape
        self.left = shape[0] if shape else 1
        """rows not read yet"""
        self.row_bytes = dtype.itemsize * math.prod(shape[1:])
        self._is_by_columns = by_columns and len(shape) > 1
        self._whole: Array | None = None

    def read(self, rows: int) -> Array:
        """Read the next rows; fewer at the end."""
        count = min(rows, self.left)
        if self._is_by_columns:
            if self._whole is None:
                flat = np.frombuffer(self._member.read(), self.dtype)
                self._whole = flat.reshape(self.shape, order="F")
            begin = len(self._whole) - self.left
            self.left -= count
            return self._whole[begin : begin + count]
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
