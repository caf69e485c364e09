"""A function in a process of its own, with its own environment: other people's libraries in there
cannot be told anything after their start, and may end the process that loads them."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any


class AbsentError(Exception):
    """What a yardstick needs is not on this machine; the message says what, and the mend."""


class Elsewhere:
    """The function: `call` returns what it returns, `run` only waits for it."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def call(self, *args: object) -> Any:
        """Its result."""
        return self._ask(args, True)

    def run(self, *args: object) -> None:
        """No more than a message either way, so that nothing else is timed."""
        self._ask(args, False)

    def _ask(self, args: tuple[object, ...], wanted: bool) -> Any:
        self._pipe.send((args, wanted))
        return self._pipe.recv()


@contextmanager
def elsewhere(
    make: Callable[..., Callable[..., object]], *args: object, environment: dict[str, str]
) -> Iterator[Elsewhere]:
    """What `make(*args)` returns, there. In: environment, set before anything is imported.

    Raises AbsentError where `make` does.
    """
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_serve, args=(theirs, make, args), daemon=True)
    before = dict(os.environ)
    os.environ |= environment
    process.start()
    os.environ.clear()
    os.environ |= before
    theirs.close()
    try:
        absent = ours.recv()
        if absent:
            raise AbsentError(absent)
        yield Elsewhere(ours)
    finally:
        # it ends when nobody is left to ask
        ours.close()
        process.join(10)
        process.kill()


def _serve(
    pipe: Connection,
    make: Callable[..., Callable[..., object]],
    args: tuple[object, ...],
) -> None:
    try:
        function = make(*args)
    except AbsentError as absent:
        pipe.send(str(absent))
        return
    pipe.send("")
    while True:
        try:
            asked, wanted = pipe.recv()
        except EOFError:
            return
        result = function(*asked)
        pipe.send(result if wanted else None)
