"""Limit the memory of this process for a block, as ulimit -v does."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager

from evs.emulator.base.memory_limits import SIZE_FILE


@contextmanager
def address_space(more_bytes: int) -> Iterator[None]:
    """Limit this process to so much more memory than it has now, for the block."""
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
