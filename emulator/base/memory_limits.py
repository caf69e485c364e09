"""How much memory and how many cores this process may have: the machine's, or less by a limit."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

MEMORY_FILE = Path("/proc/meminfo")
SIZE_FILE = Path("/proc/self/statm")
GROUP_FILE = Path("/proc/self/cgroup")
GROUPS = Path("/sys/fs/cgroup")

_FILES = {
    True: ("memory.max", "memory.current", "inactive_file"),
    False: ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}
"""whether it is of version 2 -> files of limit and use, and what of that the kernel gives back"""


def memory_gb() -> tuple[float, float]:
    """(total, free for this process), GB. Without /proc the free part is taken for the whole.

    Limits on address space (ulimit -v) and of control groups (containers, systemd) count.
    """
    found: dict[str, float] = {}
    if MEMORY_FILE.is_file():
        for line in MEMORY_FILE.read_text().splitlines():
            key, _, value = line.partition(":")
            if value.split()[1:] == ["kB"]:
                found[key] = int(value.split()[0]) * 1024 / 1e9
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    total = found.get("MemTotal", total)
    free = found.get("MemAvailable", total)
    space = _address_space()
    for most, used in (*(() if space is None else (space,)), *_groups()):
        total, free = min(total, most / 1e9), min(free, max(0, most - used) / 1e9)
    return total, free


def address_space_left() -> int | None:
    """How many more bytes this process may map (ulimit -v); None without a limit."""
    space = _address_space()
    return None if space is None else space[0] - space[1]


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


def _address_space() -> tuple[int, int] | None:
    """(most, used) bytes, where there is a limit."""
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most == resource.RLIM_INFINITY:
        return None
    with suppress(OSError):
        pages = int(SIZE_FILE.read_text().split()[0])
        return most, pages * os.sysconf("SC_PAGE_SIZE")
    return None


def _groups() -> Iterator[tuple[int, int]]:
    """(most, used) bytes of each control group over this process that has a limit on memory."""
    with suppress(OSError):
        for line in GROUP_FILE.read_text().splitlines():
            _, _, rest = line.partition(":")
            kinds, _, place = rest.partition(":")
            if kinds and "memory" not in kinds.split(","):
                continue
            root = GROUPS if not kinds else GROUPS / "memory"
            group = root / place.strip("/")
            # a container may see its own group only, as the root
            for folder in (group, *group.parents):
                if not folder.is_relative_to(root):
                    break
                yield from _group(folder, not kinds)


def _group(folder: Path, is_v2: bool) -> Iterator[tuple[int, int]]:
    limit, use, given_back = _FILES[is_v2]
    with suppress(OSError, ValueError):  # no limit: no file, or the word max
        most = int((folder / limit).read_text())
        used = int((folder / use).read_text())
        stat = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
        yield most, used - int(stat.get(given_back, 0))


def cores() -> int:
    """Return how many cores this process may use; all of the machine's if that is unknown."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
