"""What a job may ask and say while it runs, wherever that is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from evs.drivers.clock import monotonic_s

TELL_S = 0.1
"""a job is heard no more often"""


@dataclass
class Here:
    """Where the job of this process runs; one at a time."""

    threads: int = 0
    tell: Callable[[float], None] = lambda _: None
    told_s: float = -TELL_S


_here = Here()


@contextmanager
def job_runs(threads: int, tell: Callable[[float], None]) -> Iterator[None]:
    """A job runs in this block. In: its threads, who is told how far it is."""
    global _here
    before, _here = _here, Here(threads, tell)
    try:
        yield
    finally:
        _here = before


def job_threads() -> int:
    """Worker threads that the running job may use; 0: one a core."""
    return _here.threads


def tell_share(share: float) -> None:
    """Say that the running job is done to this share, 0 ... 1; cheap, call it as often as you like.

    On a cluster nobody hears it.
    """
    now_s = monotonic_s()
    if now_s - _here.told_s >= TELL_S:
        _here.told_s = now_s
        _here.tell(share)
