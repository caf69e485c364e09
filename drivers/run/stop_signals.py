"""Ctrl-C and SIGTERM as a request that a loop checks, so that it ends between two ticks."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from evs.drivers.clock import monotonic_s

_AT_ONCE_S = 0.2
"""nobody insists so soon"""


@contextmanager
def stop_signals() -> Iterator[list[str]]:
    """A list that gets "interrupted" at Ctrl-C, "terminated" at SIGTERM; the second one interrupts.

    The same signal twice at once is one: `timeout` sends it to a program and to its group. Only the
    main thread can take signals; elsewhere the list stays empty. What handled the signals before
    does so again after the block.
    """
    stopped: list[str] = []
    first_s = 0.0
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return

    def stop(number: int, _: Any) -> None:
        nonlocal first_s
        # the loop may hang in a tick that never ends: who insists is obeyed at once
        if stopped:
            if monotonic_s() - first_s < _AT_ONCE_S:
                return
            raise KeyboardInterrupt
        first_s = monotonic_s()
        stopped.append("interrupted" if number == signal.SIGINT else "terminated")

    numbers = {"interrupted": signal.SIGINT, "terminated": signal.SIGTERM}
    before = {number: signal.signal(number, stop) for number in numbers.values()}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    outer = before[signal.SIGINT]
    if stopped and isinstance(outer, Ending):
        outer(numbers.get(stopped[0], signal.SIGINT), None)


class Ending:
    """A handler that ends a command of many runs, as KeyboardInterrupt or SystemExit(143)."""

    def __init__(self) -> None:
        self._number = 0

    def __call__(self, number: int, _: Any) -> None:
        """Raise; the signal stays known, for libraries catch what is raised while they load."""
        self._number = number
        self.check()

    def check(self) -> None:
        """Raise again where a signal came before."""
        if self._number == signal.SIGINT:
            raise KeyboardInterrupt
        if self._number:
            raise SystemExit(128 + self._number)


@contextmanager
def ending_signals() -> Iterator[Ending]:
    """Ctrl-C and SIGTERM end the block; a run in it ends as `stop_signals` has it, then the block.

    Only the main thread can take signals; elsewhere nothing changes.
    """
    ending = Ending()
    if threading.current_thread() is not threading.main_thread():
        yield ending
        return
    before = {number: signal.signal(number, ending) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield ending
        ending.check()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
