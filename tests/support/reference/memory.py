"""Memory that a process has now, and the most that it has had."""

from __future__ import annotations

import gc
import os
from pathlib import Path

LEAST_BYTES = 16
"""The least that an object kept in each tick would add: pymalloc's step; malloc's is 32."""

PEAK = """
import re, sys
def peak_kib():
    # ru_maxrss is that of the process that started this one, where it is larger
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1])
"""
"""Python text that defines peak_kib(); for `python -c`."""


def resident_bytes() -> int:
    """Return the bytes of this process in RAM, after garbage collection."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGESIZE")
