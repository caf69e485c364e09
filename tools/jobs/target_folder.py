"""TargetFolder: the folder of results, each complete or absent."""

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
from evs.tools.jobs.job import remedy_for

PREFIX = ".making-"
"""of the hidden folders in which jobs run"""


class TargetFolder:
    """The folder of results. Several runs may share it; the first result of a job is kept."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def has(self, name: str) -> bool:
        """Whether a job has a result."""
        return (self.folder / name).exists()

    @contextlib.contextmanager
    def staging(self) -> Iterator[Path]:
        """A hidden folder for incomplete results, on the same disk; removed after the block.

        The folders of killed runs are removed.

        Raises:
            EvsError: the target folder cannot be written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            # locked while the folder is made, so that no other run removes it as abandoned
            with _locked(self.folder, fcntl.LOCK_EX):
                for left in self.folder.glob(f"{PREFIX}*"):
                    with _locked(left, fcntl.LOCK_EX | fcntl.LOCK_NB) as is_left:
                        if is_left:
                            shutil.rmtree(left, ignore_errors=True)
                here = Path(tempfile.mkdtemp(prefix=PREFIX, dir=self.folder))
                stack = contextlib.ExitStack()
                stack.enter_context(_locked(here, fcntl.LOCK_SH))
        except OSError as reason:
            raise EvsError(f"cannot write to '{self.folder}': {reason.strerror}") from None
        with stack:
            try:
                yield here
            finally:
                shutil.rmtree(here, ignore_errors=True)

    def store(self, name: str, made: Path) -> None:
        """Move the files of a job to their place.

        Raises:
            EvsError: the job wrote nothing, or the disk is full.
        """
        target = self.folder / name
        try:
            found = _sync_all(made)
            if not found:
                raise EvsError(f"{name}: it has written nothing")
            alone = made / target.name
            source = alone if found == [alone] and alone.is_file() else made
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                source.rename(target)
            except OSError as reason:
                # another run was first and wrote the same bytes
                if reason.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                    raise
            _sync(target.parent)
        except OSError as reason:
            raise EvsError(
                f"cannot write {target}: {reason.strerror}{remedy_for(reason)}"
            ) from None


@contextlib.contextmanager
def _locked(folder: Path, how: int) -> Iterator[bool]:
    """Lock a folder for the block or until this process dies; False if that is not possible."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        yield False
        return
    try:
        try:
            fcntl.flock(handle, how)
        except OSError:
            # somebody else holds it, or the file system cannot lock folders
            yield False
        else:
            yield True
    finally:
        os.close(handle)


def _sync_all(folder: Path) -> list[Path]:
    """Sync a folder to the disk, against power cuts; returns its entries."""
    found = sorted(folder.iterdir())
    for path in found:
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise EvsError(f"a job wrote {path.name}, which is not a file; jobs write only files")
        if path.is_dir():
            _sync_all(path)
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
