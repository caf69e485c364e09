"""h5py, where it is installed, with the compressions that public data sets use."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from evs.drivers.files.hdf5.superblock import BYTES, unmarked
from evs.msgs import EvsError

ECF_FILTER = 0x8ECF
"""HDF5's number of Metavision's codec; no package on PyPI has the filter itself"""

MAX_PIECE_BYTES = 1 << 28
"""most bytes of a chunk, which is decompressed as a whole"""


def load() -> Any:
    """Import the library; EvsError names the extra where it is missing."""
    try:
        import h5py
        import hdf5plugin
    except ImportError:
        raise EvsError("HDF5 recordings need h5py: pip install 'evs[formats]'") from None
    # importing it registers DSEC's compression, Blosc; the name has to be used
    assert hdf5plugin is not None
    return h5py


class _Mended(io.FileIO):
    """A file whose first bytes are replaced."""

    def __init__(self, path: Path, begin: bytes) -> None:
        super().__init__(path, "r")
        self._begin = begin

    def readinto(self, buffer: Any) -> int | None:
        """As FileIO's."""
        at = self.tell()
        count = super().readinto(buffer)
        if count and at < len(self._begin):
            part = self._begin[at : at + count]
            memoryview(buffer).cast("B")[: len(part)] = part
        return count


class OutsideError(Exception):
    """A file refers to another one, or states more data than it can hold."""


def own(group: Any, path: str, depth: int = 8) -> Any:
    """The object at a path within the file; None: nothing. OutsideError: it leads to another file.

    HDF5 would follow links, and read data sets' bytes, from any file of the machine.
    """
    h5py = load()
    for name in filter(None, path.split("/")):
        link = group.get(name, getlink=True) if hasattr(group, "keys") else None
        if link is None:
            return None
        if isinstance(link, h5py.ExternalLink):
            raise OutsideError(f"{name} is a link to another file, which is not read")
        if isinstance(link, h5py.SoftLink):
            if not depth:
                raise OutsideError(f"{name} is a link to links without end")
            begin = group.file if link.path.startswith("/") else group
            group = own(begin, link.path, depth - 1)
        else:
            group = group[name]
    if isinstance(group, h5py.Dataset):
        _check_inside(group)
    return group


def _check_inside(one: Any) -> None:
    """OutsideError where a data set's bytes are in other files, or its chunks are too large."""
    layout = one.id.get_create_plist()
    if layout.get_external_count() or one.is_virtual:
        raise OutsideError(f"{one.name} lies in another file, which is not read")
    piece = math.prod(one.chunks) * one.dtype.itemsize if one.chunks else one.dtype.itemsize
    if piece > MAX_PIECE_BYTES:
        raise OutsideError(f"{one.name} has pieces of {piece} bytes")


def filters(one: Any) -> list[int]:
    """The numbers of a data set's filters."""
    layout = one.id.get_create_plist()
    return [layout.get_filter(k)[0] for k in range(layout.get_nfilters())]


def value(group: Any, path: str, raw: Path) -> Any:
    """The value of a scalar data set of the file `raw`; None where there is none or several."""
    found = own(group, path)
    if getattr(found, "size", None) != 1:
        return None
    if found.dtype.kind == "O":
        # HDF5 would reserve whatever length a text states, which is its first number
        at = found.id.get_offset()
        if at is None:
            return None
        with raw.open("rb") as file:
            file.seek(at)
            stated = int.from_bytes(file.read(4), "little")
        if stated > raw.stat().st_size:
            raise OutsideError(f"{path} states a text of {stated} bytes")
    return found[()]


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a file for reading, even if its writer was killed and it is marked as being written."""
    h5py = load()
    with path.open("rb") as file:
        begin = unmarked(file.read(BYTES), path.stat().st_size)
    if begin is None:
        with h5py.File(path, "r") as found:
            yield found
    else:
        with _Mended(path, begin) as mended, h5py.File(mended, "r") as found:
            yield found
