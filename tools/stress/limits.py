"""Less memory than the machine has, for a while: ulimit -v, from inside."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager

from evs.emulator.base.memory_limits import SIZE_FILE


@contextmanager
def address_space(more_bytes: int) -> Iterator[None]:
    """This process gets so much more memory than it has now, and no more, inside the block."""
    pages = int(SIZE_FILE.read_text().split()[0])
    before, most = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + more_bytes
    if before != resource.RLIM_INFINITY:
        limit = min(limit, before)
    resource.setrlimit(resource.RLIMIT_AS, (limit, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (before, most))
