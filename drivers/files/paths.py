"""Paths of recordings: which file to read, and why one cannot be written."""

from __future__ import annotations

import os
from pathlib import Path

from evs.drivers.files.formats import SUFFIXES
from evs.msgs import EvsError, nearest_first


def target_error(path: Path, reason: OSError) -> EvsError:
    """One line for a file that cannot be written, with the fix."""
    folder = path.parent
    if isinstance(reason, FileNotFoundError | NotADirectoryError) and not folder.is_dir():
        return EvsError(f"cannot write {path}: there is no folder {folder}; mkdir -p {folder}")
    if isinstance(reason, IsADirectoryError):
        return EvsError(f"cannot write {path}: it is a folder; give a file name")
    return EvsError(f"cannot write {path}: {reason.strerror}; choose a place that you can write to")


def existing(path: str | os.PathLike[str]) -> Path:
    """The path of a file that is there; EvsError names its neighbours, nearest first."""
    found = Path(path)
    try:
        found.stat()
    except FileNotFoundError:
        pass
    except OSError as reason:
        raise EvsError(f"cannot read {found}: {reason.strerror}") from None
    if found.is_file():
        return found
    if found.is_dir():
        raise EvsError(f"{found} is a folder; give a file in it")
    if found.exists():
        raise EvsError(f"{found} is a pipe or a device: write what it gives to a file first")
    if not found.parent.is_dir():
        raise EvsError(f"no file {found}: there is no folder {found.parent}")
    known = {file.name for file in found.parent.iterdir() if file.suffix in SUFFIXES}
    shown = ", ".join(nearest_first(found.name, known)[:5])
    there = f"the folder has: {shown}" if shown else "the folder has no recordings"
    raise EvsError(f"no file {found}; {there}")
