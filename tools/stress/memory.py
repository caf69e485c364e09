"""Memory of this process: limit it for a block, and measure it."""

from __future__ import annotations

import gc
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager

from evs.emulator.base.memory_limits import SIZE_FILE


@contextmanager
def address_space(more_bytes: int) -> Iterator[None]:
    """Limit this process to its present memory and `more_bytes` for the block, as ulimit -v."""
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


LEAST_BYTES = 16
"""smallest leak that is visible: the step of pymalloc; that of malloc is 32"""


def resident_bytes() -> int:
    """Resident memory of this process after a garbage collection; Linux only."""
    gc.collect()
    return int(SIZE_FILE.read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
