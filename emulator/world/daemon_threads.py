"""Exiting: daemon threads that observe end before the interpreter does.

Up to 3.13 CPython stops a daemon thread wherever it next wants the interpreter's lock, and frames
of MuJoCo's bindings on its stack crash the process then. At a snapshot it can be ended in peace.
"""

from __future__ import annotations

import atexit
import threading
from contextlib import suppress
from functools import cache
from weakref import WeakSet

_PATIENCE_S = 1.0
"""How long the exit waits for their next snapshots."""

_daemons: WeakSet[threading.Thread] = WeakSet()
"""those that have taken a snapshot"""
_exiting = threading.Event()


class _Here(threading.local):
    """What is known of a thread, from its first snapshot on."""

    def __init__(self) -> None:
        thread = threading.current_thread()
        self.is_daemon = thread.daemon
        if self.is_daemon:
            _daemons.add(thread)


_here = _Here()


@cache
def end_daemons_at_exit() -> None:
    """Let the interpreter's exit end them; what the user registers later is called before."""
    atexit.register(_end)


def end_here() -> None:
    """Before a snapshot: SystemExit if this thread is a daemon and the interpreter exits."""
    if _here.is_daemon and _exiting.is_set():
        raise SystemExit


def _end() -> None:
    _exiting.set()
    patience_s = _PATIENCE_S
    for thread in list(_daemons):
        # one that Python has not made cannot be joined
        with suppress(AssertionError, RuntimeError):
            thread.join(patience_s)
        # one that sleeps elsewhere is waited for once
        patience_s = 0.0 if thread.is_alive() else patience_s
