"""Units of work, one after the other or several at once in processes of their own."""

from __future__ import annotations

import signal
import warnings
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, Generic, TypeVar

from evs.drivers.cores import cores
from evs.msgs import EvsError
from evs.tools.jobs import worker
from evs.tools.jobs.here import job_runs

Unit = TypeVar("Unit")
Value = TypeVar("Value")

TRIES = 3
"""How often a unit is begun before it is given up: its worker died each time."""
MOST_WORKERS = 1024


def work_off(
    todo: list[Unit],
    do: Callable[[Unit], Value],
    workers: int = 1,
    *,
    threads: int = 0,
    stopped: Callable[[], bool] = lambda: False,
    on_lost: Callable[[str], None] = warnings.warn,
    on_share: Callable[[Unit, float], None] = lambda _unit, _share: None,
) -> Generator[tuple[Unit, Value], None, None]:
    """Do all of `todo`, and give each unit with its value when it is done.

    Whoever iterates may add to `todo` in between. A unit that raises ends it, after those that run
    beside it; so does `stopped`. A unit whose worker dies is done again by another one.

    In: do, a function of a module, as processes need it with workers over 1; workers, how many
    units are done at once; threads, of each unit, 0: its share of the cores; stopped, asked before
    each unit; on_lost, told a line when a worker dies; on_share, told how far a unit is, 0 ... 1.
    Raises what a unit raises, EvsError where workers die TRIES times over one unit.
    """
    if not 1 <= workers <= MOST_WORKERS:
        raise EvsError(f"{workers} workers cannot be: give 1 ... {MOST_WORKERS}")
    if workers == 1:
        while todo and not stopped():
            unit = todo.pop(0)
            with job_runs(threads, partial(on_share, unit)):
                value = do(unit)
            yield unit, value
        return
    crew = _Crew(do, workers, threads or max(1, cores() // workers), on_lost, on_share)
    try:
        yield from crew.work_off(todo, stopped)
    finally:
        crew.end()


def name_of(unit: object) -> str:
    """What a unit is called in messages."""
    return str(getattr(unit, "name", unit))


@dataclass
class _Worker(Generic[Unit]):
    process: SpawnProcess
    pipe: Connection
    unit: Unit | None = None
    """what it is at"""
    is_ready: bool = False


@dataclass
class _Crew(Generic[Unit, Value]):
    """Worker processes, started when they are needed and replaced when they die."""

    do: Callable[[Unit], Value]
    size: int
    threads: int
    on_lost: Callable[[str], None]
    on_share: Callable[[Unit, float], None]
    workers: list[_Worker[Unit]] = field(default_factory=list)
    again: list[Unit] = field(default_factory=list)
    """units whose worker died"""
    tries: Counter[int] = field(default_factory=Counter)
    """id of a unit -> how often a worker died over it"""
    failure: Exception | None = None

    def work_off(
        self, todo: list[Unit], stopped: Callable[[], bool]
    ) -> Iterator[tuple[Unit, Value]]:
        """As the function."""
        while True:
            while (todo or self.again) and self.failure is None and self._is_free():
                # what a dead worker left goes first; a stop leaves both
                if stopped():
                    break
                self._hand_out((self.again or todo).pop(0))
            busy = [w for w in self.workers if w.unit is not None]
            if not busy:
                break
            for pipe in wait([w.pipe for w in busy]):
                one = next(w for w in busy if w.pipe is pipe)
                yield from self._hear(one)
        if self.failure is not None:
            raise self.failure

    def _is_free(self) -> bool:
        return len(self.workers) < self.size or any(w.unit is None for w in self.workers)

    def _hand_out(self, unit: Unit) -> None:
        one = next((w for w in self.workers if w.unit is None), None) or self._start()
        one.unit = unit
        # where it died while it had nothing to do, its end is heard next
        with suppress(OSError):
            one.pipe.send(unit)

    def _start(self) -> _Worker[Unit]:
        # spawn: nothing of this process, its threads least of all, goes along
        spawn = get_context("spawn")
        ours, theirs = spawn.Pipe()
        process = spawn.Process(
            target=worker.serve, args=(theirs, self.do, self.threads), name="evs-worker"
        )
        process.start()
        theirs.close()
        self.workers.append(_Worker(process, ours))
        return self.workers[-1]

    def _hear(self, one: _Worker[Unit]) -> Iterator[tuple[Unit, Value]]:
        """Take one message of a worker that has a unit."""
        unit = one.unit
        assert unit is not None
        try:
            kind, value = one.pipe.recv()
        except (EOFError, OSError):
            self._lose(one, unit, "")
            return
        if kind == worker.READY:
            one.is_ready = True
        elif kind == worker.MOVED:
            self.on_share(unit, value)
        elif kind == worker.WARNED:
            warnings.warn(value[0], value[1], stacklevel=2)
        elif kind == worker.DONE:
            one.unit = None
            self.tries.pop(id(unit), None)
            yield unit, value
        elif kind == worker.FAILED:
            one.unit = None
            self.failure = self.failure or value
        else:
            self._lose(one, unit, "it found no memory")

    def _lose(self, one: _Worker[Unit], unit: Unit, why: str) -> None:
        """A worker is gone: its unit is put back, or given up."""
        if why:
            one.process.kill()
        one.process.join()
        one.pipe.close()
        self.workers.remove(one)
        why = why or _told_of_end(one.process.exitcode)
        self.tries[id(unit)] += 1
        count = self.tries[id(unit)]
        if count < TRIES:
            self.again.append(unit)
            self.on_lost(f"{name_of(unit)}: its worker died ({why}); it is made again")
            return
        mend = "give fewer --workers, or look for what ends them"
        if not one.is_ready:
            mend = "a script that starts workers does so under `if __name__ == '__main__':`"
        self.failure = self.failure or EvsError(
            f"{name_of(unit)}: its worker died {count} times (the last: {why}); {mend}"
        )

    def end(self) -> None:
        """No worker is left; what one is at is lost."""
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


def _told_of_end(code: int | None) -> str:
    if code is None or code >= 0:
        return f"exit code {code}"
    name: Any = -code
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"{name}; out of memory?" if name == "SIGKILL" else str(name)
