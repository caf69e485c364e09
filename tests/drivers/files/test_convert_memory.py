"""evs convert takes no more memory for a recording that is ten times as long, frames or not."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.time_order import MAX_REORDER_EVENTS
from evs.msgs import EventPacket, Frame, StreamInfo, make_events
from reference.memory import PEAK

pytestmark = [pytest.mark.extremes, pytest.mark.slow]

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
TARGETS = ("csv", "npz", "aedat", "aedat3", "raw", "evt21", "dat", "h5", "hdf5", "mcap", "bag")


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


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Path, int]]:
    """0.5 and 5 million events, which are 8 and 80 MB in memory."""
    folder = tmp_path_factory.mktemp("sources")
    lengths = {"short": 500_000, "long": 5_000_000}
    return [(record(folder / f"{name}.aedat4", count), count) for name, count in lengths.items()]


def peak_kib(source: Path, target: Path) -> int:
    words = [sys.executable, "-c", CONVERT, str(source), str(target)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


@pytest.mark.parametrize("suffix", TARGETS)
def test_memory_does_not_grow_with_the_recording(
    tmp_path: Path, suffix: str, sources: list[tuple[Path, int]]
) -> None:
    # both ways
    peaks = []
    for source, count in sources:
        made, back = tmp_path / f"{source.stem}.{suffix}", tmp_path / source.name
        there = peak_kib(source, made)
        peaks.append((there, peak_kib(made, back)))
        assert files.summary(back).events == count
    (short, short_back), (long, long_back) = peaks
    assert long - short < 40_000
    assert long_back - short_back < 40_000
    assert max(long, long_back) < 500_000


@pytest.mark.parametrize("suffix", ["aedat4", "aedat", "aedat3", "csv", "npz"])
def test_read_takes_little_more_than_the_events(tmp_path: Path, suffix: str) -> None:
    long = record(tmp_path / f"long.{suffix}", 4_000_000)
    short = record(tmp_path / f"short.{suffix}", 100_000)
    words = [sys.executable, "-c", READ, str(long), str(short)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=True)
    count, grown_kib = map(int, done.stdout.split())
    # 16 bytes an event, an eighth to grow into, the last part, and what waits for late events: an
    # eighth more before any is given out, and that eighth once more while it is
    assert grown_kib * 1024 < 1.2 * 16 * count + 16e6 + 1.25 * 16 * MAX_REORDER_EVENTS


def aedat3(folder: Path, frames: int) -> Path:
    """Frames of 180 kB, 50 a second."""
    sink: Any = files.recorder_for(folder / "a.aedat3")
    sink.open([StreamInfo(346, 260, frames=True)])
    for seq in range(frames):
        at = 20_000 * seq
        pixels = np.full((260, 346), seq, np.uint16)
        sink.write_frame(Frame(seq, at, at, at + 5, at + 9, pixels))
        t = np.arange(at + 10, at + 1010)
        sink.write(EventPacket(seq, 0, 0, 346, 260, make_events(t, t % 346, t % 260, t % 2)))
    sink.close()
    return folder / "a.aedat3"


def davis(folder: Path, frames: int) -> Path:
    """A DAVIS240's words: 0.7 MB a frame, and an event between two words of them."""
    x, y = np.repeat(np.arange(240), 180), np.tile(np.arange(180), 240)
    place = (y << 22 | x << 12).astype(np.uint32)
    reads = np.concatenate([1 << 31 | place | 1000, 1 << 31 | place | 1 << 10 | 500])
    words = np.zeros((len(reads), 2, 2), ">u4")
    words[:, 0, 0], words[:, 1, 0] = reads, np.concatenate([place, place])
    with (folder / "a.aedat").open("wb") as file:
        file.write(b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n")
        for seq in range(frames):
            words[:, :, 1] = 100_000 * seq + np.arange(len(reads))[:, np.newaxis]
            file.write(words.tobytes())
    return folder / "a.aedat"


def rotated(folder: Path, parts: int) -> Path:
    """Files of 100,000 events."""
    sink = files.recorder_for(folder / "a.aedat4", rotate_s=0.1)
    sink.open([StreamInfo(346, 260)])
    for tick in range(100 * parts):
        t = np.arange(1000 * tick + 1, 1000 * tick + 1001)
        events = make_events(t, t % 346, t % 260, t % 2)
        sink.write(EventPacket(tick, 1000 * tick, 1000 * tick + 1000, 346, 260, events))
    sink.close()
    return folder / "a.aedat4"


@pytest.mark.parametrize(
    ("make", "target", "count"),
    [(aedat3, "b.aedat4", 80), (davis, "b.aedat4", 12), (rotated, "b.aedat3", 5)],
)
def test_memory_does_not_grow_with_frames_and_files(
    tmp_path: Path, make: Callable[[Path, int], Path], target: str, count: int
) -> None:
    peaks = []
    for name, many in (("short", count), ("long", 10 * count)):
        folder = tmp_path / name
        folder.mkdir()
        source = make(folder, many)
        words = [sys.executable, "-c", CONVERT, str(source), str(folder / target)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == 0, done.stderr
        peaks.append(int(done.stdout))
        found = files.summary(folder / target)
        assert found.events == files.summary(source).events > 0
        assert found.frames == (0 if make is rotated else many)
    assert peaks[1] - peaks[0] < 40_000
    assert peaks[1] < 500_000
