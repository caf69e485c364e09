"""A viewer's sink on a disk that fills up."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from evs.drivers.search_path import search_path

BYTES = 300_000

_PROGRAM = """
import resource, sys
from evs.drivers.search_path import search_path
from evs.drivers import viewer
from evs.drivers.sink import SinkStoppedError
from evs.msgs import EventPacket, StreamInfo, make_events
import numpy as np

# a file size limit is what a full disk is to a process
limit = int(sys.argv[4])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
sink = getattr(viewer, sys.argv[1])(**{sys.argv[2]: sys.argv[3]})
sink.open([StreamInfo(346, 260, camera="eye")])
random = np.random.default_rng(0)
try:
    for k in range(20_000):
        x = random.integers(0, 260, 200)
        events = make_events(np.full(200, 20_000 * k + 1), x, x[::-1], x % 2)
        sink.write(EventPacket(k, 20_000 * k, 20_000 * k + 20_000, 346, 260, events, "eye"))
except SinkStoppedError as error:
    assert sink.close()["error"] == str(error), sink.close()
    print(error)
"""


def fill(sink: str, option: str, file: Path) -> str:
    """Write events in a process of its own until BYTES bytes are full; what the sink then says."""
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, sink, option, str(file), str(BYTES)],
        env={**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert file.stat().st_size == BYTES
    return done.stdout
