"""Units of work, one after the other or several at once in processes of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing import get_context
from typing import TypeVar

from evs.msgs import EvsError

Unit = TypeVar("Unit")
Value = TypeVar("Value")


def work_off(
    todo: list[Unit], do: Callable[[Unit], Value], jobs: int = 1
) -> Iterator[tuple[Unit, Value]]:
    """Do all of `todo`, and give each unit with its value when it is done.

    Whoever iterates may add to `todo` in between. In: do, a function of a module, as processes need
    it with jobs over 1; jobs, how many units are done at once.
    """
    if jobs < 1:
        raise EvsError(f"jobs is {jobs}: give 1 or more")
    if jobs == 1:
        while todo:
            unit = todo.pop(0)
            yield unit, do(unit)
        return
    # spawn: nothing of this process, its threads least of all, goes along
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        running: dict[Future[Value], Unit] = {}
        while todo or running:
            while todo:
                unit = todo.pop(0)
                running[pool.submit(do, unit)] = unit
            for done in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(done), done.result()
