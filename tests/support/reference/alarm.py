"""A reader that waits for ever is ended by an alarm, not by the patience of the suite."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def not_waited_for(seconds: int = 5) -> Iterator[None]:
    """Fail the test if the block takes longer."""
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("it waits"))
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
