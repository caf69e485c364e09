"""Space for a file that is written later."""

from __future__ import annotations

import os

_CHUNK = 1 << 20


def allocate(file: int, size: int) -> None:
    """Make sure that the first `size` bytes of a file have space; bytes beyond its end become 0.

    Where the system has no posix_fallocate, as macOS, the zeros are written.

    Args:
        file: Number of a file that is open for writing.
        size: Bytes; a longer file keeps its length.

    Raises:
        OSError: There is no space. The file has the length that it had.
    """
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
        return
    before = end = os.fstat(file).st_size
    try:
        while end < size:
            end += os.pwrite(file, bytes(min(_CHUNK, size - end)), end)
    except OSError:
        os.ftruncate(file, before)
        raise
