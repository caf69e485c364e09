"""The context of a running job: how many threads it may use, and where progress goes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from evs.drivers.clock import monotonic_s

REPORT_INTERVAL_S = 0.1
"""shortest time between two progress reports"""


@dataclass
class JobContext:
    """The context of the job that this process runs; one at a time."""

    threads: int = 0
    report: Callable[[float], None] = lambda _: None
    reported_s: float = -REPORT_INTERVAL_S


_context = JobContext()


@contextmanager
def job_context(threads: int, report: Callable[[float], None]) -> Iterator[None]:
    """Run a job in this block.

    Args:
        threads: worker threads that the job may use.
        report: receives its progress, 0 ... 1.
    """
    global _context
    before, _context = _context, JobContext(threads, report)
    try:
        yield
    finally:
        _context = before


def job_threads() -> int:
    """Worker threads that the running job may use; 0: one per core."""
    return _context.threads


def report_progress(share: float) -> None:
    """Report how much of the running job is done. It is cheap: call it as often as you like.

    A cluster does not forward it.

    Args:
        share: 0 ... 1.
    """
    now_s = monotonic_s()
    if now_s - _context.reported_s >= REPORT_INTERVAL_S:
        _context.reported_s = now_s
        _context.report(share)
