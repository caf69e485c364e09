"""A function in a process of its own, with an environment of its own.

The third-party libraries that it loads cannot be configured after their start, and may end the
process that loads them.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any


class AbsentError(Exception):
    """What a yardstick needs is missing on this machine; the message names it and the remedy."""


class Elsewhere:
    """The function: `call` returns its result, `run` only waits for it."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def call(self, *args: object) -> Any:
        """Call the function and return its result."""
        return self._ask(args, True)

    def run(self, *args: object) -> None:
        """Call the function without returning its result, so that little else is timed."""
        self._ask(args, False)

    def _ask(self, args: tuple[object, ...], wanted: bool) -> Any:
        self._pipe.send((args, wanted))
        return self._pipe.recv()


@contextmanager
def elsewhere(
    make: Callable[..., Callable[..., object]], *args: object, environment: dict[str, str]
) -> Iterator[Elsewhere]:
    """Run `make(*args)` in a process of its own, which serves the function that it returns.

    Args:
        make: Makes the function, in that process.
        *args: The arguments of `make`.
        environment: Variables that are set in that process before anything is imported.

    Yields:
        The function; the process ends with the block.

    Raises:
        AbsentError: If `make` raises it.
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
        # the process ends when the pipe is closed
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
