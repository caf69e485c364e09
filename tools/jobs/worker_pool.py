"""Run units of work one after the other, or at once in worker processes."""

from __future__ import annotations

import os
import pickle
import signal
import threading
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.process import parent_process
from typing import Any, Generic, TypeVar

from evs.emulator.base.memory_limits import cores
from evs.msgs import EvsError
from evs.tools.jobs.job import job_context

Unit = TypeVar("Unit")
Value = TypeVar("Value")

MAX_ATTEMPTS = 3
"""how often a unit is started before it fails, if its worker dies each time"""
MOST_WORKERS = 1024

READY, PROGRESS, WARNED, DONE, FAILED, OUT_OF_MEMORY = (
    "ready",
    "moved",
    "warned",
    "done",
    "failed",
    "starved",
)
"""kinds of messages of a worker; the second element of a message is its value"""


def run_units(
    todo: list[Unit],
    do: Callable[[Unit], Value],
    workers: int = 1,
    *,
    threads: int = 0,
    stopped: Callable[[], bool] = lambda: False,
    on_lost: Callable[[str], None] = warnings.warn,
    on_share: Callable[[Unit, float], None] = lambda _unit, _share: None,
) -> Generator[tuple[Unit, Value], None, None]:
    """Run all of `todo`; yield each unit with its value when it is done.

    The caller may add to `todo` while it iterates. A unit that raises ends the iteration after the
    units that run; so does `stopped`. A unit whose worker dies is run again by another worker.

    Args:
        todo: the units; emptied.
        do: runs a unit; with several workers a function of a module.
        workers: how many units run at once; 1: in this process.
        threads: threads of each unit; 0: its share of the cores.
        stopped: polled before each unit.
        on_lost: called with a line when a worker died.
        on_share: called with the progress of a unit, 0 ... 1.

    Raises:
        EvsError: workers died MAX_ATTEMPTS times on one unit.
        Exception: whatever a unit raises.
    """
    if not 1 <= workers <= MOST_WORKERS:
        raise EvsError(f"workers is {workers}: give 1 ... {MOST_WORKERS}")
    if workers == 1:
        while todo and not stopped():
            unit = todo.pop(0)
            with job_context(threads, partial(on_share, unit)):
                value = do(unit)
            yield unit, value
        return
    pool = _WorkerPool(do, workers, threads or max(1, cores() // workers), on_lost, on_share)
    try:
        yield from pool.run_units(todo, stopped)
    finally:
        pool.end()


def name_of(unit: object) -> str:
    """Name of a unit, for messages."""
    return str(getattr(unit, "name", unit))


@dataclass
class _Worker(Generic[Unit]):
    """A worker process, as the pool sees it."""

    process: SpawnProcess
    pipe: Connection
    unit: Unit | None = None
    """the unit that it runs"""
    is_ready: bool = False


@dataclass
class _WorkerPool(Generic[Unit, Value]):
    """Worker processes, started on demand and replaced when they die."""

    do: Callable[[Unit], Value]
    size: int
    threads: int
    on_lost: Callable[[str], None]
    on_share: Callable[[Unit, float], None]
    workers: list[_Worker[Unit]] = field(default_factory=list)
    retries: list[Unit] = field(default_factory=list)
    """units whose worker died"""
    attempts: Counter[int] = field(default_factory=Counter)
    """id of a unit -> how often a worker died over it"""
    failure: Exception | None = None

    def run_units(
        self, todo: list[Unit], stopped: Callable[[], bool]
    ) -> Iterator[tuple[Unit, Value]]:
        """See run_units."""
        while True:
            while (todo or self.retries) and self.failure is None and self._is_free():
                # units of dead workers go first; after a stop both lists stay
                if stopped():
                    break
                self._assign((self.retries or todo).pop(0))
            busy = [w for w in self.workers if w.unit is not None]
            if not busy:
                break
            for pipe in wait([w.pipe for w in busy]):
                one = next(w for w in busy if w.pipe is pipe)
                yield from self._receive(one)
        if self.failure is not None:
            raise self.failure

    def _is_free(self) -> bool:
        return len(self.workers) < self.size or any(w.unit is None for w in self.workers)

    def _assign(self, unit: Unit) -> None:
        one = next((w for w in self.workers if w.unit is None), None) or self._start()
        one.unit = unit
        # if it died while idle, _receive finds out
        with suppress(OSError):
            one.pipe.send(unit)

    def _start(self) -> _Worker[Unit]:
        # spawn: workers inherit nothing of this process, least of all its threads
        spawn = get_context("spawn")
        ours, theirs = spawn.Pipe()
        process = spawn.Process(
            target=_run_worker, args=(theirs, self.do, self.threads), name="evs-worker"
        )
        process.start()
        theirs.close()
        self.workers.append(_Worker(process, ours))
        return self.workers[-1]

    def _receive(self, one: _Worker[Unit]) -> Iterator[tuple[Unit, Value]]:
        """Receive one message of a busy worker; yield its unit if that is done."""
        unit = one.unit
        assert unit is not None
        try:
            kind, value = one.pipe.recv()
        except (EOFError, OSError):
            self._retry_or_fail(one, unit, "")
            return
        if kind == READY:
            one.is_ready = True
        elif kind == PROGRESS:
            self.on_share(unit, value)
        elif kind == WARNED:
            warnings.warn(value[0], value[1], stacklevel=2)
        elif kind == DONE:
            one.unit = None
            self.attempts.pop(id(unit), None)
            yield unit, value
        elif kind == FAILED:
            one.unit = None
            self.failure = self.failure or value
        else:
            self._retry_or_fail(one, unit, "it found no memory")

    def _retry_or_fail(self, one: _Worker[Unit], unit: Unit, why: str) -> None:
        """Handle the death of a worker: queue its unit again, or fail."""
        if why:
            one.process.kill()
        one.process.join()
        one.pipe.close()
        self.workers.remove(one)
        why = why or _exit_reason(one.process.exitcode)
        self.attempts[id(unit)] += 1
        count = self.attempts[id(unit)]
        if count < MAX_ATTEMPTS:
            self.retries.append(unit)
            self.on_lost(f"{name_of(unit)}: its worker died ({why}); it is made again")
            return
        mend = "give fewer --workers, or look for what ends them"
        if not one.is_ready:
            mend = "a script that starts workers does so under `if __name__ == '__main__':`"
        self.failure = self.failure or EvsError(
            f"{name_of(unit)}: its worker died {count} times (the last: {why}); {mend}"
        )

    def end(self) -> None:
        """Stop all workers; units that run are lost."""
        for one in self.workers:
            one.pipe.close()
            if one.unit is not None:
                one.process.kill()
        for one in self.workers:
            one.process.join(5)
            if one.process.is_alive():
                one.process.kill()
                one.process.join()
        self.workers.clear()


def _exit_reason(code: int | None) -> str:
    if code is None or code >= 0:
        return f"exit code {code}"
    name: Any = -code
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"{name}; out of memory?" if name == "SIGKILL" else str(name)


def _run_worker(pipe: Connection, do: Callable[[Any], Any], threads: int) -> None:
    """The main loop of a worker process: run the units from the pipe until it is closed."""
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
            pipe.send((FAILED, _picklable(error)))


def _done(do: Callable[[Any], Any], unit: Any) -> tuple[str, Any]:
    try:
        return DONE, do(unit)
    except MemoryError:
        return OUT_OF_MEMORY, None
    except Exception as error:
        return FAILED, _picklable(error)


def _picklable(error: Exception) -> Exception:
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
