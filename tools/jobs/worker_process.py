"""The main loop of a worker process: receive units, run them, send the results."""

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

from evs.tools.jobs.job_context import job_context

READY, PROGRESS, WARNED, DONE, FAILED, OUT_OF_MEMORY = (
    "ready",
    "moved",
    "warned",
    "done",
    "failed",
    "starved",
)
"""kinds of messages of a worker; the second element of a message is its value"""


def serve(pipe: Connection, do: Callable[[Any], Any], threads: int) -> None:
    """Run the units that come through the pipe until it is closed."""
    # Ctrl-C reaches all processes of a terminal; the parent decides what it means
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()

    def warned(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        pipe.send((WARNED, (str(message), category)))

    warnings.showwarning = warned
    pipe.send((READY, None))
    while True:
        try:
            unit = pipe.recv()
        except EOFError:
            return
        with job_context(threads, lambda share: pipe.send((PROGRESS, share))):
            message = _done(do, unit)
        try:
            pipe.send(message)
        except (AttributeError, TypeError, pickle.PicklingError) as error:
            pipe.send((FAILED, picklable(error)))


def _done(do: Callable[[Any], Any], unit: Any) -> tuple[str, Any]:
    try:
        return DONE, do(unit)
    except MemoryError:
        return OUT_OF_MEMORY, None
    except Exception as error:
        return FAILED, picklable(error)


def picklable(error: Exception) -> Exception:
    """The exception, or a substitute that pickle can send, with its traceback as a note."""
    text = "".join(traceback.format_exception(error)).rstrip()
    sent: Exception = RuntimeError(f"{type(error).__name__}: {error}")
    # some exceptions of libraries cannot be pickled, or not read again
    with suppress(Exception):
        sent = pickle.loads(pickle.dumps(error))
    sent.add_note(f"in another process:\n{text}")
    return sent


def _exit_with_parent() -> None:
    """Exit when the parent is gone, even if it was killed."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
