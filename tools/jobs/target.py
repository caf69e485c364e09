"""Target: the folder where jobs arrive, each whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from evs.msgs import EvsError
from evs.tools.jobs.make import mend_of

PREFIX = ".making-"
"""of the hidden folders beside the jobs in which they are made"""


class Target:
    """The folder. Several runs may write to one at the same time; who comes second gives way."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def has(self, name: str) -> bool:
        """Whether a job has arrived."""
        return (self.folder / name).exists()

    @contextlib.contextmanager
    def making(self) -> Iterator[Path]:
        """A hidden folder for what is not whole yet, on the same disk; gone after the block.

        What killed runs left is removed. Raises EvsError where the folder cannot be written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            # held while one is made, so that nobody takes it for left before it is locked
            with _held(self.folder, fcntl.LOCK_EX):
                for left in self.folder.glob(f"{PREFIX}*"):
                    with _held(left, fcntl.LOCK_EX | fcntl.LOCK_NB) as is_left:
                        if is_left:
                            shutil.rmtree(left, ignore_errors=True)
                here = Path(tempfile.mkdtemp(prefix=PREFIX, dir=self.folder))
                stack = contextlib.ExitStack()
                stack.enter_context(_held(here, fcntl.LOCK_SH))
        except OSError as reason:
            raise EvsError(f"cannot write to '{self.folder}': {reason.strerror}") from None
        with stack:
            try:
                yield here
            finally:
                shutil.rmtree(here, ignore_errors=True)

    def arrive(self, name: str, made: Path) -> None:
        """Move what a job made to its place. Raises EvsError: it made nothing, the disk is full."""
        target = self.folder / name
        try:
            found = _settle(made)
            if not found:
                raise EvsError(f"{name}: it has written nothing")
            alone = made / target.name
            source = alone if found == [alone] and alone.is_file() else made
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                source.rename(target)
            except OSError as reason:
                # another run was first; its bytes are the same
                if reason.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                    raise
            _sync(target.parent)
        except OSError as reason:
            raise EvsError(f"cannot write {target}: {reason.strerror}{mend_of(reason)}") from None


@contextlib.contextmanager
def _held(folder: Path, how: int) -> Iterator[bool]:
    """A lock on a folder, which ends with its process; False where it is not to be had."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        yield False
        return
    try:
        try:
            fcntl.flock(handle, how)
        except OSError:
            # somebody has it, or the file system knows no locks on folders
            yield False
        else:
            yield True
    finally:
        os.close(handle)


def _settle(folder: Path) -> list[Path]:
    """Bring all of a folder to the disk, so that no power cut halves it; Out: what lies in it."""
    found = sorted(folder.iterdir())
    for path in found:
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise EvsError(f"a job wrote {path.name}, which is no file; jobs write files only")
        if path.is_dir():
            _settle(path)
        else:
            _sync(path)
    _sync(folder)
    return found


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
