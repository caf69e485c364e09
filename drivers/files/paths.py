"""Paths of recordings: which file to read, whether one may be written, and why one cannot be."""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import count
from pathlib import Path

from evs.drivers.files.formats import SUFFIXES
from evs.emulator.base.small_files import is_file
from evs.msgs import EvsError, nearest_first


def target_error(path: Path, reason: OSError) -> EvsError:
    """The error for a file that cannot be written: one line with the fix."""
    folder = path.parent
    if isinstance(reason, FileNotFoundError | NotADirectoryError) and not folder.is_dir():
        return EvsError(f"cannot write {path}: there is no folder {folder}; mkdir -p {folder}")
    if isinstance(reason, IsADirectoryError):
        return EvsError(f"cannot write {path}: it is a folder; give a file name")
    return EvsError(f"cannot write {path}: {reason.strerror}; choose a place that you can write to")


def stopped_text(path: Path, events: int, reason: OSError, outcome: str) -> str:
    """The message of a recorder that a full disk stops.

    Args:
        path: The recording.
        events: How many events it holds.
        reason: The error of the operating system.
        outcome: What becomes of them, in words.
    """
    return (
        f"recording to {path} stopped after {events} events: {reason.strerror}; {outcome}; free "
        "some space and run again"
    )


def existing(path: str | os.PathLike[str]) -> Path:
    """The path of an existing file.

    Raises:
        EvsError: It does not exist (the message lists recordings in its folder, the most similar
            names first), is no regular file, or cannot be reached.
    """
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
    siblings = f"the folder has: {shown}" if shown else "the folder has no recordings"
    raise EvsError(f"no file {found}; {siblings}")


FORCE = "use --force (in a pipeline: overwrite = true) to replace it"
"""the fix, for programs that take both"""


def check_new(paths: Iterable[str | Path], fix: str = "use --force to replace it") -> None:
    """Check that no file would be overwritten. Devices and pipes are not files.

    Args:
        paths: The files to be written.
        fix: How to overwrite them, for the message.

    Raises:
        EvsError: One of the files exists.
    """
    for path in map(Path, paths):
        if is_file(path):
            raise EvsError(f"'{path}' already exists: {fix}, or give another name")


def numbered_path(path: str, number: int) -> str:
    """The name of a recording next to earlier ones: run-1.aedat4; its own name for number 0."""
    own = Path(path)
    return str(own.with_name(f"{own.stem}-{number}{own.suffix}")) if number else path


def free_number(paths: Iterable[str]) -> int:
    """The lowest number for which none of the numbered paths exists."""
    wanted = list(paths)
    return next(
        n for n in count() if not any(Path(numbered_path(path, n)).exists() for path in wanted)
    )
