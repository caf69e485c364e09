"""Send the files of a job over a network: pack them into messages, unpack and check them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from evs.msgs import EvsError

PIECE_BYTES = 4 << 20
"""largest piece of a file; a job in flight needs a few of them, however large its files are"""


@dataclass(frozen=True)
class FileEntry:
    """The begin of a file or folder; the pieces of a file follow."""

    path: str
    """below the job's folder, with slashes"""
    size: int
    """bytes; -1: a folder"""


@dataclass(frozen=True)
class StreamEnd:
    """The last message: the digest of all before it."""

    digest: str
    """SHA-256 of all entries and pieces"""
    warnings: tuple[tuple[str, type[Warning]], ...] = ()
    """warnings of the job"""


Message = FileEntry | bytes | StreamEnd


def pack(folder: Path) -> Iterator[FileEntry | bytes]:
    """Pack a folder into messages.

    Raises:
        EvsError: the folder holds something that is neither a file nor a folder.
    """
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise EvsError(f"a job wrote {name}, which is not a file; jobs write only files")
        if path.is_dir():
            yield FileEntry(name, -1)
            continue
        yield FileEntry(name, path.stat().st_size)
        with path.open("rb") as file:
            while piece := file.read(PIECE_BYTES):
                yield piece


class StreamDigest:
    """SHA-256 over messages."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def add(self, message: FileEntry | bytes) -> None:
        """Add a message."""
        self._hash.update(message if isinstance(message, bytes) else repr(message).encode())

    def hexdigest(self) -> str:
        """The digest of all messages so far."""
        return self._hash.hexdigest()


class Unpacker:
    """Writes the messages of `pack` into a new folder and checks that all have come."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.end: StreamEnd | None = None
        """the last message, once it has come"""
        self._digest = StreamDigest()
        self._file: Path | None = None
        folder.mkdir(parents=True)

    def write(self, message: Message) -> None:
        """Write one message.

        Raises:
            EvsError: the messages are damaged or out of order.
            OSError: it cannot be written, as on a full disk.
        """
        if isinstance(message, StreamEnd):
            if message.digest != self._digest.hexdigest():
                raise EvsError("its files were damaged on their way; give the command again")
            self.end = message
            return
        self._digest.add(message)
        if isinstance(message, bytes):
            if self._file is None:
                raise EvsError("a piece came before its file; give the command again")
            with self._file.open("ab") as file:
                file.write(message)
            return
        path = self.folder / message.path
        if message.size < 0:
            path.mkdir()
        else:
            path.touch(exist_ok=False)
            self._file = path
