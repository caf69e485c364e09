"""`evs view --web` and `evs emulate --view`: the page of a publisher."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evs.drivers.sink_config import SinkConfig


def run(args: argparse.Namespace) -> int:
    """Serve the page until the publisher ends, --timeout without a packet, or Ctrl-C."""
    from evs.drivers.viewer.web.program import PageRequest, serve

    serve(
        PageRequest(
            args.web,
            args.control,
            args.camera,
            args.port,
            args.timeout,
            args.server_key,
            args.key,
            not args.no_browser,
        )
    )
    return 0


@contextmanager
def page_of_run(wanted: bool) -> Iterator[list[SinkConfig]]:
    """Show the page of a run that begins inside; the sinks that feed it."""
    from evs.drivers.sink_config import ZmqSink

    if not wanted:
        yield []
        return
    from evs.drivers.viewer.web.program import PageRequest, page_beside

    with tempfile.TemporaryDirectory(prefix="evs-view-") as folder:
        packets, control = (f"ipc://{Path(folder) / name}" for name in ("packets", "control"))
        with page_beside(PageRequest(packets, control)):
            yield [ZmqSink(address=packets, control=control, wait_for=1, worker=False)]
