"""How many processor cores there are to use."""

from __future__ import annotations

import os


def cores() -> int:
    """How many this process may use; where the system does not say, all of the machine's."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
