"""The far end of a worker process: takes units, does them, says what came of them."""

from __future__ import annotations

import os
import pickle
import signal
import threading
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import parent_process
from typing import Any

from evs.tools.jobs.here import job_runs

READY, MOVED, WARNED, DONE, FAILED, STARVED = (
    "ready",
    "moved",
    "warned",
    "done",
    "failed",
    "starved",
)
"""What a worker says first; the rest of the message is its value."""


def serve(pipe: Connection, do: Callable[[Any], Any], threads: int) -> None:
    """Do what comes through the pipe until it is closed. In: threads of each unit."""
    # Ctrl-C goes to all processes of a terminal; who started this one decides what it means
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def warned(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        pipe.send((WARNED, (str(message), category)))

    warnings.showwarning = warned
    pipe.send((READY, None))
    while True:
        try:
            unit = pipe.recv()
        except EOFError:
            return
        with job_runs(threads, lambda share: pipe.send((MOVED, share))):
            said = _done(do, unit)
        try:
            pipe.send(said)
        except (AttributeError, TypeError, pickle.PicklingError) as error:
            pipe.send((FAILED, portable(error)))


def _done(do: Callable[[Any], Any], unit: Any) -> tuple[str, Any]:
    try:
        return DONE, do(unit)
    except MemoryError:
        return STARVED, None
    except Exception as error:
        return FAILED, portable(error)


def portable(error: Exception) -> Exception:
    """An exception as it can be sent, with where it came from as a note."""
    told = "".join(traceback.format_exception(error)).rstrip()
    sent: Exception = RuntimeError(f"{type(error).__name__}: {error}")
    # some exceptions of libraries cannot be pickled, or not read again
    with suppress(Exception):
        sent = pickle.loads(pickle.dumps(error))
    sent.add_note(f"in another process:\n{told}")
    return sent


def _end_with_parent() -> None:
    """No worker outlives a parent that was killed."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
