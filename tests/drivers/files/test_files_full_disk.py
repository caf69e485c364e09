"""A disk that is full ends a recording that is appended to; all before it is there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers.files import read, summary

PROGRAM = """
import resource, sys
import numpy as np
from evs.drivers.files import recorder_for
from evs.drivers.sink import SinkStoppedError
from evs.msgs import EventPacket, StreamInfo, make_events

resource.setrlimit(resource.RLIMIT_FSIZE, (100_000,) * 2)
sink = recorder_for(sys.argv[1])
sink.open([StreamInfo(346, 260)])
written = 0
try:
    for begin in range(0, 100_000, 500):
        t = np.arange(begin + 1, begin + 501)
        sink.write(EventPacket(0, 0, 0, 346, 260, make_events(t, t % 346, t % 260, t % 2)))
        written += 500
except SinkStoppedError as error:
    print(error)
report = sink.close()
assert report["events"] == written
assert report["error"]
print(written, report["bytes"])
"""


@pytest.mark.parametrize("name", ["a.aedat", "a.aedat3", "a.csv", "a.dat", "a.evt21"])
def test_what_came_before_is_whole(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    words = [sys.executable, "-c", PROGRAM, str(path)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
    said, numbers = done.stdout.splitlines()
    written, size = map(int, numbers.split())
    assert f"recording to {path} stopped after {written} events: File too large" in said
    assert 4000 < written < 13_000
    assert path.stat().st_size == size
    # no half packet is left behind: reading warns of nothing
    assert read(path)["t"].tolist() == list(range(1, written + 1))
    assert summary(path).torn_at is None
