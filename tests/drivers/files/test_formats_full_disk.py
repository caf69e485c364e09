"""A full disk stops a recording; all before it is there, appended or written by a library."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers import files
from evs.drivers.files import library_recorder
from evs.drivers.sink import SinkStoppedError
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, join_events
from reference.streams import random_events

pytestmark = pytest.mark.extremes

NAMES = ["a.h5", "a.hdf5", "a.mcap", "a.db3", "a.bag"]
DISK_BYTES = 9_700_000

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


def packet(tick: int) -> EventPacket:
    events = random_events(2000, 1000 * tick, 1000 * tick + 1000, (1280, 720), tick)
    return EventPacket(tick, 0, 0, 1280, 720, events)


@pytest.mark.parametrize("name", NAMES)
def test_what_came_before_is_kept(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk of some MB, by what the system says of room on it."""
    whole = os.posix_fallocate

    def limited(file: int, offset: int, length: int) -> None:
        on_disk = sum(each.stat().st_size for each in tmp_path.rglob("*") if each.is_file())
        if on_disk + offset + length > DISK_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        whole(file, offset, length)

    monkeypatch.setattr(library_recorder.os, "posix_fallocate", limited)
    path = tmp_path / name
    sink = files.recorder_for(path)
    sink.open([StreamInfo(1280, 720)])
    written: list[Events] = []

    def record() -> None:
        for tick in range(5000):
            sink.write(packet(tick))
            written.append(packet(tick).events)

    with pytest.raises(SinkStoppedError, match=r"No space left on device; they are kept; free"):
        record()
    with pytest.raises(SinkStoppedError, match="stopped after"):
        sink.write(packet(5000))
    report = sink.close()
    assert report["error"].startswith(f"recording to {path} stopped after ")
    assert report["events"] == 2000 * len(written) > 50_000
    assert path.stat().st_size < DISK_BYTES
    assert files.read(path).tobytes() == join_events(written).tobytes()
    assert files.summary(path).torn_at is None
    assert [one.name for one in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", NAMES)
def test_a_disk_without_any_room_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(file: int, offset: int, length: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(library_recorder.os, "posix_fallocate", full)
    sink = files.recorder_for(tmp_path / name)
    with pytest.raises(EvsError, match="No space left on device"):
        sink.open([StreamInfo(1280, 720)])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.aedat", "a.aedat3", "a.csv", "a.dat", "a.evt21"])
def test_what_was_appended_before_is_whole(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    words = [sys.executable, "-c", PROGRAM, str(path)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
    said, numbers = done.stdout.splitlines()
    written, size = map(int, numbers.split())
    assert f"recording to {path} stopped after {written} events: File too large" in said
    assert 4000 < written < 13_000
    assert path.stat().st_size == size
    # no half packet is left behind: reading warns of nothing
    assert files.read(path)["t"].tolist() == list(range(1, written + 1))
    assert files.summary(path).torn_at is None
