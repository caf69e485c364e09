"""Repair of an HDF5 file whose recorder was killed."""

from __future__ import annotations

from pathlib import Path

from evs.drivers.files.hdf5.reader import Hdf5File
from evs.drivers.files.hdf5.superblock import BYTES, unmarked
from evs.drivers.files.integrity import Repair
from evs.drivers.files.paths import target_error


def repair(path: Path) -> Repair:
    """Clear the mark that the file is being written. EvsError: not a recording, not writable."""
    found = Hdf5File.at(path)
    try:
        with found.path.open("r+b") as file:
            mended = unmarked(file.read(BYTES), found.size)
            if mended is None:
                return Repair(found.path, 0, found.size, False)
            file.seek(0)
            file.write(mended)
    except OSError as reason:
        raise target_error(found.path, reason) from None
    return Repair(found.path, 0, found.size, False, "took back the mark that it is being written")
