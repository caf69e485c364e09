"""Hundreds of subscribers of everything are killed: the publisher keeps nothing of them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.bus import Publisher
from evs.drivers.bus.curve_keys import write_keys
from evs.drivers.clock import monotonic_s, sleep_s
from evs.msgs import EventPacket, Frame, StreamInfo, make_events

pytestmark = pytest.mark.integration

HORDE = """
import os, signal, sys
from evs.drivers.bus import Latest, discover, subscribe
events, control, latest, key = sys.argv[1:]
keys = {"server_key": key} if key else {}
for line in sys.stdin:
    # a process of its own each, which shares no thread of ZeroMQ with this one
    born = []
    for number in range(int(line)):
        child = os.fork()
        if child == 0:
            if number % 10 == 0:
                discover(control, timeout_s=60, **keys)
            state = Latest(latest, **keys)
            stream = subscribe(events, frames=True, imu=True, poses=True, camera_info=True, **keys)
            packet = stream.receive(60)
            state.get(60)
            os.kill(os.getpid(), signal.SIGKILL if packet is not None else signal.SIGTERM)
        born.append(child)
    ends = [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in born]
    print(ends.count(-signal.SIGKILL), flush=True)
"""
AT_ONCE = 25


class Camera:
    """Events and frames, a thousand packets a second as far as the machine has time."""

    def __init__(self, folder: Path, *, keys: bool) -> None:
        any_port = "tcp://127.0.0.1:0"
        self.key, secret = map(str, write_keys(folder / "camera")) if keys else ("", "")
        self.sink = Publisher(any_port, control=any_port, key=secret, linger_s=0.1)
        self.sink.open([StreamInfo(64, 48, "cam", frames=True)])
        stamps = np.sort(np.random.default_rng(0).integers(1, 1001, 500))
        self.body = make_events(stamps, stamps % 64, stamps % 48, stamps % 2)
        self.seq = 0

    def send(self) -> None:
        events, base_us = self.body.copy(), 1000 * self.seq
        events["t"] += base_us
        self.sink.write(EventPacket(self.seq, base_us, base_us + 1000, 64, 48, events, "cam"))
        if self.seq % 10 == 0:
            pixels = np.zeros((48, 64), np.uint8)
            self.sink.write_frame(
                Frame(
                    self.seq // 10, base_us, base_us, base_us + 900, base_us + 1000, pixels, "cam"
                )
            )
        self.seq += 1
        sleep_s(0.001)

    def send_until_nobody_listens(self) -> None:
        deadline_s = monotonic_s() + 60
        while self.sink.subscribers:
            self.send()
            assert monotonic_s() < deadline_s


def held() -> tuple[int, int]:
    """File descriptors and memory (kB) of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return len(list(Path("/proc/self/fd").iterdir())), pages * os.sysconf("SC_PAGE_SIZE") // 1024


@pytest.mark.slow
@pytest.mark.parametrize("times", [12, pytest.param(40, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("keys", [False, True], ids=["plain", "keys"])
def test_killed_subscribers_leave_nothing(tmp_path: Path, keys: bool, times: int) -> None:
    camera = Camera(tmp_path, keys=keys)
    sink = camera.sink
    where = [sink.address, sink.control_address, sink.latest_address, camera.key]
    pipe = subprocess.PIPE
    horde = subprocess.Popen(
        [sys.executable, "-W", "error", "-c", HORDE, *where], stdin=pipe, stdout=pipe, text=True
    )
    assert horde.stdin is not None
    assert horde.stdout is not None
    os.set_blocking(horde.stdout.fileno(), False)
    early: tuple[int, int] | None = None
    try:
        for turn in range(times):
            horde.stdin.write(f"{AT_ONCE}\n")
            horde.stdin.flush()
            deadline_s = monotonic_s() + 120
            said = ""
            while not (said := said + horde.stdout.readline()).endswith("\n"):
                camera.send()
                assert monotonic_s() < deadline_s
            assert int(said) == AT_ONCE
            camera.send_until_nobody_listens()
            # what the first crowds cost stays for the next ones
            if turn == times // 4:
                early = held()
    finally:
        horde.kill()
        horde.communicate()
    assert early is not None
    late = held()
    assert camera.sink.close()["states_sent"] > 0
    assert abs(late[0] - early[0]) <= AT_ONCE // 2
    # 200 more, at least, came and went; each would have left 100 kB of queued packets if any
    assert late[1] - early[1] < 5_000
