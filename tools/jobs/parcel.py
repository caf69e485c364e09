"""The files of a job as a stream of pieces, checked at the other end: how they cross a network."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from evs.msgs import EvsError

PIECE_BYTES = 4 << 20
"""Of one piece at most; what is under way takes a few times this, however large a file is."""


@dataclass(frozen=True)
class Entry:
    """A file or folder that begins; a file's pieces follow it."""

    path: str
    """below the job's folder, with slashes"""
    size: int
    """bytes; -1: it is a folder"""


@dataclass(frozen=True)
class End:
    """The last word: what everything before it must add up to."""

    digest: str
    """SHA-256 of all entries and pieces"""
    warnings: tuple[tuple[str, type[Warning]], ...] = ()
    """what the job warned of"""


Said = Entry | bytes | End


def pack(folder: Path) -> Iterator[Entry | bytes]:
    """Everything in a folder. Raises EvsError where something is neither file nor folder."""
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise EvsError(f"a job wrote {name}, which is no file; jobs write files only")
        if path.is_dir():
            yield Entry(name, -1)
            continue
        yield Entry(name, path.stat().st_size)
        with path.open("rb") as file:
            while piece := file.read(PIECE_BYTES):
                yield piece


class Digest:
    """SHA-256 over what is said."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def add(self, said: Entry | bytes) -> None:
        """One more."""
        self._hash.update(said if isinstance(said, bytes) else repr(said).encode())

    def told(self) -> str:
        """In hexadecimal."""
        return self._hash.hexdigest()


class Parcel:
    """Writes what `pack` gave into a new folder, and knows when all of it is there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.end: End | None = None
        """the last word, when it was heard"""
        self._digest = Digest()
        self._at: Path | None = None
        folder.mkdir(parents=True)

    def take(self, said: Said) -> None:
        """Write it. Raises EvsError where it is damaged, OSError where the disk is full."""
        if isinstance(said, End):
            if said.digest != self._digest.told():
                raise EvsError("its files were damaged on their way; give the command again")
            self.end = said
            return
        self._digest.add(said)
        if isinstance(said, bytes):
            if self._at is None:
                raise EvsError("a piece came before its file; give the command again")
            with self._at.open("ab") as file:
                file.write(said)
            return
        path = self.folder / said.path
        if said.size < 0:
            path.mkdir()
        else:
            path.touch(exist_ok=False)
            self._at = path
