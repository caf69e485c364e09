"""How much memory this process has, and when that means that something was kept."""

from __future__ import annotations

import gc
import os
from pathlib import Path

LEAST_BYTES = 16
"""The least that an object kept in each tick would add: pymalloc's step; malloc's is 32."""


def resident_bytes() -> int:
    """Memory of this process that is in RAM, after what nothing refers to is gone."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGESIZE")
