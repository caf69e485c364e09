"""h5py, where it is installed, with the compressions that public data sets use."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from evs.drivers.files.hdf5.superblock import BYTES, unmarked
from evs.msgs import EvsError


def load() -> Any:
    """The library; EvsError says how to install it."""
    try:
        import h5py
        import hdf5plugin
    except ImportError:
        raise EvsError("HDF5 recordings need h5py: pip install 'evs[formats]'") from None
    # importing it registers DSEC's compression, Blosc; it asks to be named
    assert hdf5plugin is not None
    return h5py


class _Mended(io.FileIO):
    """A file that begins otherwise than on the disk."""

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


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A file to read; also one whose writer was killed, which says that it is being written."""
    h5py = load()
    with path.open("rb") as file:
        begin = unmarked(file.read(BYTES), path.stat().st_size)
    if begin is None:
        with h5py.File(path, "r") as found:
            yield found
    else:
        with _Mended(path, begin) as mended, h5py.File(mended, "r") as found:
            yield found
