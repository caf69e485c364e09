"""The page of a publisher, in this process or in one of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from typing import Any

from evs.drivers.bus import request, subscribe
from evs.drivers.viewer.display import has_display
from evs.drivers.viewer.web.feed import BusFeed
from evs.drivers.viewer.web.server import PageServer, need_web

_ANSWER_S = 2.0
_END_S = 10.0
"""how long the page's process may take to end after its publisher"""


@dataclass(frozen=True)
class PageRequest:
    """Which publisher is shown, and where."""

    address: str
    """of the packets"""
    control: str = ""
    """of its control port; empty: nothing can be changed"""
    camera: str = ""
    """empty: all"""
    port: int = 0
    """of the page, on 127.0.0.1; 0: any free one"""
    timeout_s: float | None = None
    """seconds without a packet after which it ends; None: never"""
    server_key: str = ""
    """see `subscribe`"""
    key: str = ""
    """see `subscribe`"""
    browser: bool = True
    """whether to open a browser, where there is a display"""


def serve(wanted: PageRequest, stop: Callable[[], bool] = lambda: False) -> None:
    """Serve the page until the publisher ends, `stop` returns True, or Ctrl-C.

    Its address is printed.

    Raises:
        EvsError: The extra is not installed, the port is in use, or the publisher refuses us.
    """
    need_web()
    keys: dict[str, Any] = {"server_key": wanted.server_key, "key": wanted.key}

    def ask(name: str, arguments: dict[str, object]) -> dict[str, Any]:
        return request(wanted.control, name, arguments, timeout_s=_ANSWER_S, **keys)

    def show(address: str) -> None:
        sys.stdout.write(f"view: {address}\n")
        sys.stdout.flush()
        if wanted.browser and has_display():
            webbrowser.open(address)

    with (
        subscribe(wanted.address, wanted.camera, frames=True, lights=True, **keys) as stream,
        BusFeed(stream, wanted.timeout_s) as feed,
        suppress(KeyboardInterrupt),
    ):
        server = PageServer(feed, ask if wanted.control else None, port=wanted.port)
        server.run(show, stop)


@contextmanager
def page_beside(wanted: PageRequest) -> Iterator[None]:
    """Serve the page in a process of its own, which ends with the publisher or with this process.

    The publisher has to end inside, or soon after.

    Raises:
        EvsError: The extra is not installed.
    """
    need_web()
    command = [sys.executable, "-P", "-m", __spec__.name, json.dumps(asdict(wanted))]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        try:
            yield
        finally:
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()


def main(words: str) -> None:
    """Serve what JSON says, until standard input ends: then the process that started us is gone."""
    stopped = threading.Event()

    def wait() -> None:
        # without the lock of sys.stdin, which this thread would hold at the end
        while os.read(sys.stdin.fileno(), 1024):
            pass
        stopped.set()

    threading.Thread(target=wait, daemon=True).start()
    serve(PageRequest(**json.loads(words)), stopped.is_set)


if __name__ == "__main__":
    main(sys.argv[1])
