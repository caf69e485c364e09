"""HDF5 files are read in a process of its own, which a damaged or crafted file may crash.

The process is contents.py. One is kept for the next file; after an error it is replaced.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast
from weakref import finalize

import numpy as np
import numpy.typing as npt

from evs.drivers.files.hdf5 import contents
from evs.drivers.files.hdf5.contents import MAX_CPU_S, OutsideError
from evs.drivers.files.hdf5.superblock import BYTES, unmarked
from evs.drivers.search_path import search_path
from evs.msgs import EvsError

_MAX_ANSWER_BYTES = 1 << 28
"""of a text, or of an array"""

_NUMBER = re.compile(r"[<>|][iufb]\d{1,2}")

Column = npt.NDArray[Any]
Ask = Callable[..., Any]
"""name of a method of Contents, its arguments -> what it returns"""


class CrashError(EvsError):
    """The process ended while it read a file."""


class LibraryError(Exception):
    """The library cannot read what it was asked for."""


@dataclass(frozen=True)
class DataSet:
    """A data set of a file, as the file describes it."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    stored_bytes: int
    chunk: int
    """rows of a chunk; 0: it has none"""
    filters: tuple[int, ...]
    """their numbers"""
    compression: str

    @property
    def size(self) -> int:
        """Number of its elements."""
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        """Bytes of its elements."""
        return self.size * self.dtype.itemsize


Group = Mapping[str, "DataSet | Group | None"]
"""members of a group; those of a group in it are left out"""


class ApartFile:
    """An open HDF5 file, whose process is believed nothing that does not fit what was asked."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    def names(self) -> list[str]:
        """Names in the root."""
        return [str(name) for name in self._ask("names")]

    def describe(self, path: str) -> DataSet | Group | None:
        """What is at a path: a data set, or the members of a group; None: nothing.

        Raises:
            OutsideError: It leads to another file, or is too large.
        """
        return _node(self._ask("describe", path))

    def value(self, path: str) -> int | float | str | None:
        """The value of a scalar data set; None where there is none or several."""
        found = self._ask("value", path)
        if not isinstance(found, int | float | str | None):
            raise LibraryError(f"{path} has no value")
        return found

    def pair(self, attribute: str) -> tuple[int, int]:
        """The two numbers of an attribute of the file."""
        first, second = self._ask("pair", attribute)
        return int(first), int(second)

    def rows(
        self, path: str, columns: tuple[str, ...], fields: tuple[str, ...], begin: int, end: int
    ) -> list[Column]:
        """Some rows, (n,) values of each column; see Contents.rows."""
        found: list[Column] = self._ask("rows", path, columns, fields, begin, end)
        wanted = len(columns or fields)
        if any(len(one) != end - begin for one in found) or wanted not in (0, len(found)):
            raise LibraryError(f"{path} has not the rows {begin} to {end}")
        return found

    def chunks(self, path: str) -> dict[int, tuple[int, int, int]]:
        """First row of each chunk of a data set -> its place and bytes, and its filter mask."""
        found = self._ask("chunks", path)
        if not found:
            return {}
        rows, *others = (column.tolist() for column in found)
        return dict(zip(rows, zip(*others, strict=True), strict=True))


def _node(stated: Any) -> DataSet | Group | None:
    """What the process describes. LibraryError, or others: that makes no sense."""
    if stated is None:
        return None
    if "members" in stated:
        return {str(name): _node(one) for name, one in stated["members"].items()}
    shape = tuple(int(side) for side in stated["shape"])
    kinds = [str(kind) for kind in stated["kinds"]]
    if any(kind != "|V1" and not _NUMBER.fullmatch(kind) for kind in kinds):
        raise LibraryError("a data set has an unknown type")
    fields: Any = kinds[0]
    if stated["fields"]:
        names, offsets = zip(*stated["fields"], strict=True)
        fields = {"names": list(names), "formats": kinds, "offsets": list(offsets)}
        fields["itemsize"] = int(stated["item_bytes"])
    return DataSet(
        str(stated["name"]),
        shape,
        np.dtype(fields),
        int(stated["stored_bytes"]),
        int(stated["chunk"]),
        tuple(int(number) for number in stated["filters"]),
        str(stated["compression"]),
    )


_END_S = 10.0
"""how long a process that closed its pipes may take to end"""

PROGRAM = Path(contents.__file__).absolute()


class _Child:
    """The process; it ends with this object, with this process, and when it is not `kept`."""

    def __init__(self) -> None:
        # one thread of numpy's, whose memory counts
        environment = {"PYTHONPATH": search_path(), "OPENBLAS_NUM_THREADS": "1"}
        try:
            process = subprocess.Popen(
                [sys.executable, "-P", str(PROGRAM)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **environment},
                # Ctrl-C is this process's to deal with
                start_new_session=True,
            )
        except OSError as reason:
            raise EvsError(f"cannot start a process that reads HDF5: {reason.strerror}") from None
        self._process = process
        self._requests = cast(BinaryIO, process.stdin)
        self._replies = cast(io.BufferedReader, process.stdout)
        self.kept = True
        self.end = finalize(self, _end, process)

    def ask(self, path: Path, name: str, *arguments: Any) -> Any:
        """Call a method of Contents.

        Raises:
            OutsideError: The method does.
            LibraryError: The library cannot, or what came back is no answer.
            CrashError: The process ended.
        """
        # until there is a whole answer, also if Ctrl-C comes in between
        kept, self.kept = self.kept, False
        try:
            self._requests.write(json.dumps([name, *arguments]).encode() + b"\n")
            self._requests.flush()
            reply = json.loads(self._received(int.from_bytes(self._received(4), "little")))
            arrays = [self._array(*stated) for stated in reply.get("arrays", ())]
            failed, refused = reply.get("failed"), reply.get("refused")
        except Exception as reason:  # nothing that it sends may do harm
            raise CrashError(self._fate(path, reason)) from None
        if failed:
            raise LibraryError(failed)
        self.kept = kept
        if refused:
            raise OutsideError(refused)
        return arrays or reply.get("value")

    def _array(self, kind: str, count: int) -> Column:
        if not _NUMBER.fullmatch(kind):
            raise ValueError(f"values of type {kind[:9]!r}")
        dtype = np.dtype(kind)
        return np.frombuffer(self._received(count * dtype.itemsize), dtype)

    def _received(self, size: int) -> bytearray:
        if not 0 <= size <= _MAX_ANSWER_BYTES:
            raise ValueError(f"{size} bytes")
        found = bytearray(size)
        left = memoryview(found)
        while left:
            count = self._replies.readinto(left)
            if not count:
                raise EOFError
            left = left[count:]
        return found

    def _fate(self, path: Path, reason: Exception) -> str:
        """The line about its end, which this is."""
        how = f"answers nonsense about this file ({reason})"
        if isinstance(reason, EOFError | BrokenPipeError):
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_S)
        self.end()
        if isinstance(reason, EOFError | BrokenPipeError):
            code = self._process.returncode
            if code >= 0:
                return (
                    f"cannot read {path}: the process that reads HDF5 ended ({code}); see whether "
                    "python -c 'import h5py, hdf5plugin' works"
                )
            slow = -code == getattr(signal, "SIGXCPU", 0)
            how = f"took more than {MAX_CPU_S} s for a piece of" if slow else "crashed on"
            how = f"{how} this file (signal {-code})"
        return f"{path}: the HDF5 library {how}; it is damaged or crafted: get a sound copy"


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the process, which only reads, at once."""
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):
            cast(BinaryIO, pipe).close()


_idle: list[_Child] = []
"""at most one, for the next file"""

if hasattr(os, "register_at_fork"):
    # a process that is forked has children of its own
    os.register_at_fork(after_in_child=_idle.clear)


@contextmanager
def opened(path: Path) -> Iterator[ApartFile]:
    """Open a file for reading, even if its writer was killed and it is marked as being written.

    Raises:
        LibraryError: It is no HDF5 file, or damaged.
        CrashError: The library crashed on it.
    """
    begin = mended_begin(path)
    child = _with_file(path, str(path.absolute()), begin)
    try:
        yield ApartFile(lambda name, *arguments: child.ask(path, name, *arguments))
    except Exception:
        # perhaps it answered nonsense
        child.kept = False
        raise
    finally:
        try:
            if child.kept and child.end.alive:
                # what was read is whole; after an error the process is replaced
                with suppress(LibraryError):
                    child.ask(path, "close")
        finally:
            _keep_or_end(child)


def mended_begin(path: Path) -> str:
    """What `Contents` needs for a file that is marked as being written, in hexadecimal digits."""
    with path.open("rb") as file:
        return (unmarked(file.read(BYTES), path.stat().st_size) or b"").hex()


def _with_file(path: Path, *arguments: str) -> _Child:
    """A process that has opened the file."""
    while _idle:
        child = _idle.pop()
        # another one tells whether it is the file
        with suppress(CrashError):
            return _open(child, path, *arguments)
    return _open(_Child(), path, *arguments)


def _open(child: _Child, path: Path, *arguments: str) -> _Child:
    try:
        child.ask(path, "open", *arguments)
    except BaseException:
        child.end()
        raise
    return child


def _keep_or_end(child: _Child) -> None:
    if child.kept and child.end.alive and not _idle:
        _idle.append(child)
    else:
        child.end()
