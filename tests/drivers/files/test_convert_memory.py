"""evs convert takes no more memory for a recording that is ten times as long."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.msgs import EventPacket, StreamInfo, make_events
from reference.memory import PEAK

pytestmark = pytest.mark.extremes

CONVERT = f"""{PEAK}
from evs.launch.main import main
assert main(["convert", *sys.argv[1:], "--quiet"]) == 0
print(peak_kib())
"""
READ = f"""{PEAK}
import evs
evs.read(sys.argv[2])
before = peak_kib()
count = len(evs.read(sys.argv[1]))
print(count, peak_kib() - before)
"""
PART = 100_000
TARGETS = ("csv", "npz", "aedat", "aedat3", "raw", "evt21", "dat", "h5", "mcap", "bag")


def record(path: Path, count: int) -> Path:
    """So many events at 1 Mev/s."""
    random = np.random.default_rng(1)
    sink = files.recorder_for(path)
    sink.open([StreamInfo(346, 260)])
    for begin in range(0, count, PART):
        t = np.sort(random.integers(begin, begin + PART, PART))
        x, y = random.integers(0, 346, PART), random.integers(0, 260, PART)
        sink.write(EventPacket(0, 0, 0, 346, 260, make_events(t, x, y, t % 2)))
    sink.close()
    return path


def peak_kib(source: Path, target: Path) -> int:
    words = [sys.executable, "-c", CONVERT, str(source), str(target)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", TARGETS)
def test_memory_does_not_grow_with_the_recording(tmp_path: Path, suffix: str) -> None:
    # both ways; 0.5 and 5 million events are 8 and 80 MB in memory
    peaks = []
    for name, count in (("short", 500_000), ("long", 5_000_000)):
        source = record(tmp_path / f"{name}.aedat4", count)
        made = tmp_path / f"{name}.{suffix}"
        there = peak_kib(source, made)
        peaks.append((there, peak_kib(made, tmp_path / f"{name}2.aedat4")))
        assert files.summary(tmp_path / f"{name}2.aedat4").events == count
    (short, short_back), (long, long_back) = peaks
    assert long - short < 40_000
    assert long_back - short_back < 40_000
    assert max(long, long_back) < 500_000


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["aedat4", "aedat", "aedat3", "csv", "npz"])
def test_read_takes_little_more_than_the_events(tmp_path: Path, suffix: str) -> None:
    long = record(tmp_path / f"long.{suffix}", 4_000_000)
    short = record(tmp_path / f"short.{suffix}", 100_000)
    words = [sys.executable, "-c", READ, str(long), str(short)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=True)
    count, grown_kib = map(int, done.stdout.split())
    # 16 bytes an event, an eighth to grow into, and the last part
    assert grown_kib * 1024 < 1.2 * 16 * count + 16e6
