"""How much memory the machine has."""

from __future__ import annotations

import os
from pathlib import Path

MEMORY_FILE = Path("/proc/meminfo")


def memory_gb() -> tuple[float, float]:
    """(total, free for programs), GB. Without /proc the free part is taken for the whole."""
    found: dict[str, float] = {}
    if MEMORY_FILE.is_file():
        for line in MEMORY_FILE.read_text().splitlines():
            key, _, value = line.partition(":")
            if value.split()[1:] == ["kB"]:
                found[key] = int(value.split()[0]) * 1024 / 1e9
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    return found.get("MemTotal", total), found.get("MemAvailable", total)
