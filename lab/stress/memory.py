"""Memory of this process."""

from __future__ import annotations

import gc
import os

from evs.emulator.base.memory_limits import SIZE_FILE

LEAST_BYTES = 16
"""smallest leak that is visible: the step of pymalloc; that of malloc is 32"""


def resident_bytes() -> int:
    """Resident memory of this process after a garbage collection; Linux only."""
    gc.collect()
    return int(SIZE_FILE.read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
