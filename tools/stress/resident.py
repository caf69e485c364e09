"""How much memory this process has, and what would be seen of something kept each time."""

from __future__ import annotations

import gc
import os

from evs.emulator.base.memory_limits import SIZE_FILE

LEAST_BYTES = 16
"""The least that an object kept adds: pymalloc's step; malloc's is 32."""


def resident_bytes() -> int:
    """Memory of this process that is in RAM, after what nothing refers to is gone; Linux only."""
    gc.collect()
    return int(SIZE_FILE.read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
