"""What evs reads of an HDF5 file, with h5py; as a program, it reads for another process.

The program gets requests on its standard input, each a line of JSON: the name of a method of
Contents and its arguments, or `open` and `close` of a file. It answers on its standard output with
the length of a JSON object (uint32, little-endian), the object, and the bytes of the arrays that
the object lists. It runs under limits and ends with its standard input.

It imports nothing of evs, so that it starts fast.
"""

from __future__ import annotations

import io
import json
import math
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

MAX_PIECE_BYTES = 1 << 28
"""most bytes of a chunk, which is decompressed as a whole"""

MAX_BYTES = 1 << 31
"""most memory that the program may take in addition to what it has before it opens a file"""

MAX_CPU_S = 60
"""most processor time of one request"""


class OutsideError(Exception):
    """A file refers to another one, or states more data than it can hold."""


class _Mended(io.FileIO):
    """A file whose first bytes are replaced."""

    def __init__(self, path: str, begin: bytes) -> None:
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


def own(group: Any, path: str, depth: int = 8) -> Any:
    """The object at a path within the file; None: nothing. OutsideError: it leads to another file.

    HDF5 would follow links, and read data sets' bytes, from any file of the machine.
    """
    import h5py

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


class Contents:
    """An HDF5 file that is open. Its methods return what JSON holds, or a list of arrays."""

    def __init__(self, path: str, begin: str = "") -> None:
        """Open a file.

        Args:
            path: The file.
            begin: What replaces its first bytes, in hexadecimal digits.
        """
        import h5py
        import hdf5plugin

        # importing it registers DSEC's compression, Blosc; the name has to be used
        assert hdf5plugin is not None
        self._raw = Path(path)
        self._mended = _Mended(path, bytes.fromhex(begin)) if begin else None
        try:
            self._file = h5py.File(self._mended or path, "r")
        except BaseException:
            self._close_mended()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._close_mended()

    def _close_mended(self) -> None:
        if self._mended is not None:
            self._mended.close()

    def names(self) -> list[str]:
        """Names in the root."""
        return list(self._file)

    def describe(self, path: str) -> dict[str, Any] | None:
        """What is at a path: a data set, or a group with its members; None: nothing."""
        found = own(self._file, path)
        described = _described(found)
        if described is not None and hasattr(found, "keys"):
            described["members"] = {name: _described(own(found, name)) for name in found}
        return described

    def value(self, path: str) -> int | float | str | None:
        """The value of a scalar data set; None where there is none or several."""
        found = own(self._file, path)
        if getattr(found, "size", None) != 1:
            return None
        if found.dtype.kind == "O":
            # HDF5 would reserve whatever length a text states, which is its first number
            at = found.id.get_offset()
            if at is None:
                return None
            with self._raw.open("rb") as file:
                file.seek(at)
                stated = int.from_bytes(file.read(4), "little")
            if stated > self._raw.stat().st_size:
                raise OutsideError(f"{path} states a text of {stated} bytes")
        scalar = np.ravel(found[()])[0]
        scalar = scalar.item() if isinstance(scalar, np.generic) else scalar
        text = scalar.decode() if isinstance(scalar, bytes) else scalar
        if not isinstance(text, int | float | str):
            raise TypeError(f"{path} is no number and no text")
        return text

    def pair(self, attribute: str) -> list[int]:
        """The two numbers of an attribute of the file."""
        attributes: Any = self._file.attrs
        if attribute not in attributes or attributes.get_id(attribute).shape != (2,):
            raise OutsideError(f"{attribute} is no pair")
        return [int(number) for number in attributes[attribute]]

    def rows(self, path: str, columns: list[str], fields: list[str], begin: int, end: int) -> Any:
        """Some rows, (n,) values of each column.

        Args:
            path: Of a group, or of a data set of rows.
            columns: Names of the group's data sets; none: the data set has all.
            fields: Names of the data set's fields; none: its columns have no names.
            begin: The first row.
            end: The row after the last.
        """
        group = own(self._file, path)
        if columns:
            return [own(group, name)[begin:end] for name in columns]
        found = group[begin:end]
        return [found[name] for name in fields] if fields else list(found.T)

    def chunks(self, path: str) -> Any:
        """Where chunks of a data set lie: first row, place, bytes and filter mask, (n,) int64."""
        found: list[tuple[int, ...]] = []
        own(self._file, path).id.chunk_iter(
            lambda one: found.append(
                (one.chunk_offset[0], one.byte_offset or 0, one.size, one.filter_mask)
            )
        )
        return list(np.array(found, np.int64).reshape(-1, 4).T)


def _described(one: Any) -> dict[str, Any] | None:
    """A data set, or anything else as a group without members."""
    if one is None:
        return None
    if getattr(one, "shape", None) is None:
        return {"members": {}}
    layout, kind = one.id.get_create_plist(), one.dtype
    names = kind.names or ()
    return {
        "name": one.name,
        "shape": one.shape,
        "kinds": [_number(kind[name]) for name in names] or [_number(kind)],
        "fields": [[name, kind.fields[name][1]] for name in names],
        "item_bytes": kind.itemsize,
        "stored_bytes": one.id.get_storage_size(),
        "chunk": one.chunks[0] if one.chunks else 0,
        "filters": [layout.get_filter(k)[0] for k in range(layout.get_nfilters())],
        "compression": one.compression or "none",
    }


def _number(kind: Any) -> str:
    """A type of numbers; anything else is some bytes."""
    return str(kind.str) if kind.kind in "iufb" else "|V1"


def serve(requests: BinaryIO, replies: BinaryIO) -> None:
    """Answer requests until there are no more."""
    contents: Any = None
    for line in requests:
        name, *arguments = json.loads(line)
        _limit_time()
        value: Any = None
        arrays: list[Any] = []
        try:
            if name == "open":
                contents = Contents(*arguments)
            else:
                value = getattr(contents, name)(*arguments)
            if isinstance(value, list) and value and isinstance(value[0], np.ndarray):
                arrays, value = [np.ascontiguousarray(one) for one in value], None
            listed = [(one.dtype.str, len(one)) for one in arrays]
            head = json.dumps({"value": value, "arrays": listed})
        except OutsideError as reason:
            head, arrays = json.dumps({"refused": str(reason)}), []
        except Exception as reason:  # damaged bytes make h5py raise a dozen kinds
            text = (str(reason) or type(reason).__name__).splitlines()[0]
            head, arrays = json.dumps({"failed": text}), []
        replies.write(len(head).to_bytes(4, "little") + head.encode())
        for one in arrays:
            replies.write(one.view(np.uint8))
        replies.flush()


def _limit_space() -> None:
    """No core dump, and no more memory than MAX_BYTES; nothing where the system has no limits."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + MAX_BYTES
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        if soft == resource.RLIM_INFINITY or soft > most:
            resource.setrlimit(resource.RLIMIT_AS, (most, hard))


def _limit_time() -> None:
    """Give the request that begins MAX_CPU_S."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        most = int(used.ru_utime + used.ru_stime) + MAX_CPU_S
        if hard == resource.RLIM_INFINITY or hard > most:
            resource.setrlimit(resource.RLIMIT_CPU, (most, hard))


def main() -> None:
    """Read for the process at the other end of standard input and output."""
    import h5py
    import hdf5plugin

    # loaded before the limits are set, which count from there
    assert h5py is not None
    assert hdf5plugin is not None
    _limit_space()
    serve(sys.stdin.buffer, sys.stdout.buffer)


if __name__ == "__main__":
    main()
