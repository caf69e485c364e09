"""Memory of the page's process while a run is watched; a minute, or EVS_SOAK_S seconds.

EVS_SOAK_S=3600 .venv/bin/pytest -m bench -s lab/tests/bench/test_page_soak.py
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("websockets")

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from evs.drivers.bus import Publisher
from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.viewer.web.program import PageRequest
from evs.msgs import EventPacket, StreamInfo, make_events

pytestmark = pytest.mark.bench

WIDTH, HEIGHT = 346, 260
EVENTS = 300


def resident_mb(process: int) -> float:
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def test_a_watched_page_does_not_grow(tmp_path: Path) -> None:
    """One page draws, one never does; 1000 packets and 300,000 events a second."""
    seconds = float(os.environ.get("EVS_SOAK_S", "60"))
    address = f"ipc://{tmp_path}/packets"
    publisher = Publisher(address, wait_for=1, wait_s=30, linger_s=0.5)
    words = json.dumps(asdict(PageRequest(address, browser=False)))
    command = [sys.executable, "-m", "evs.drivers.viewer.web.program", words]
    random = np.random.default_rng(0)
    x, y = random.integers(0, (WIDTH, HEIGHT), (EVENTS, 2)).T
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        publisher.open([StreamInfo(WIDTH, HEIGHT, "left")])
        page_address = process.stdout.readline().split()[1]
        socket = page_address.replace("http", "ws").replace("/?", "/ws?")
        drawn = 0

        def draw() -> None:
            nonlocal drawn
            with suppress(ConnectionClosed):
                for message in page:
                    if isinstance(message, bytes):
                        (length,) = struct.unpack_from("<I", message)
                        header = json.loads(message[4 : 4 + length])
                        page.send(json.dumps({"camera": "left", "drawn": header["number"]}))
                        drawn += 1

        samples: list[float] = []
        with connect(socket, max_size=None) as page, connect(socket, max_size=None):
            threading.Thread(target=draw, daemon=True).start()
            begin_s = monotonic_s()
            for seq in range(round(1000 * seconds)):
                events = make_events([1000 * seq + 500] * EVENTS, x, y, x % 2)
                if publisher.wants_light("left", 1000 * seq):
                    publisher.write_light("left", 1000 * seq, np.ones((HEIGHT, WIDTH), np.float32))
                publisher.write(
                    EventPacket(seq, 1000 * seq, 1000 * seq + 1000, WIDTH, HEIGHT, events, "left")
                )
                if seq % round(50 * seconds) == 0:
                    samples.append(resident_mb(process.pid))
                sleep_s(max(0.0, begin_s + 0.001 * seq - monotonic_s()))
            took_s = monotonic_s() - begin_s
            report = publisher.close()
        process.stdin.close() if process.stdin else None
    print(f"\n{took_s:.0f} s, {report['packets_sent']:,} packets, {drawn:,} pictures drawn")
    print("resident MB:", " ".join(f"{each:.0f}" for each in samples))
    # what is kept of 10 s fills in the first tenth
    later = samples[max(2, round(len(samples) * 15 / seconds) + 1) :]
    assert max(later) < 1.1 * later[0]
