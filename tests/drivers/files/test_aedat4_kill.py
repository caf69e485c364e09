"""A recorder that is killed at any moment, also between two files, loses nothing it has written."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.files import read, repair, summary
from evs.drivers.files.integrity import TornTailWarning
from evs.drivers.files.multi_file import later_parts
from evs.msgs import join_events, make_events

pytestmark = pytest.mark.extremes

ORACLES = Path(__file__).parents[2] / "support" / "oracles" / "aedat4_oracles.py"
PACKETS = 40
FRAMES = range(1, PACKETS, 9)
"""Before which packets a frame is written; IMU samples are before each."""

RECORD = f"""
import numpy as np
from evs.drivers.files.aedat4 import Aedat4Recorder
from evs.msgs import EventPacket, Frame, ImuPacket, StreamInfo, empty_imu, make_events

def packet(seq):
    random = np.random.default_rng(seq)
    count = 1 + 97 * seq % 400
    t = np.sort(random.integers(1000 * seq + 1, 1000 * seq + 1001, count))
    x, y = random.integers(0, 346, count), random.integers(0, 260, count)
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, make_events(t, x, y, t % 2))

def frame(seq):
    image = np.random.default_rng(seq).integers(0, 256, (26, 34)).astype(np.uint8)
    begin = 1000 * seq - 900
    return Frame(seq // 9, begin, begin, begin + 500, begin + 800, image, "eye")

def imu(seq):
    samples = empty_imu(1)
    samples["t"] = 1000 * seq
    return ImuPacket(seq, samples, "eye")

def record(path, compression, tell=lambda count: None):
    sink = Aedat4Recorder(path, compression)
    sink.open([StreamInfo(346, 260, camera="eye", frames=True, imu=True)])
    tell(0)
    for seq in range({PACKETS}):
        if seq % 9 == 1:
            sink.write_frame(frame(seq))
            tell(seq)
        sink.write_imu(imu(seq))
        tell(seq)
        sink.write(packet(seq))
        tell(seq + 1)
    sink.close()
    tell(-1)
"""

AT_BYTE = """
import os, resource, signal, sys
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
for limit in map(int, sys.argv[3:]):
    child = os.fork()
    if child == 0:
        # the system kills the process in the very write that passes this many bytes
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        record(f"{sys.argv[1]}/{limit}.aedat4", sys.argv[2])
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def packet(seq: int) -> Any:
    scope: dict[str, Any] = {}
    exec(RECORD, scope)  # noqa: S102 - the very code that the killed process ran
    return scope["packet"](seq)


@pytest.fixture(scope="module")
def digests() -> list[str]:
    """The oracles' digest of the first n packets, for every n."""
    events = [packet(seq).events for seq in range(PACKETS)]
    found = []
    for count in range(PACKETS + 1):
        summed = hashlib.sha256()
        for name in "txyp":
            for part in events[:count]:
                summed.update(np.ascontiguousarray(part[name]).tobytes())
        found.append(summed.hexdigest())
    return found


def everybody(paths: list[Path], digests: list[str]) -> Iterator[tuple[Path, str, int]]:
    """(file, reader, packets read) of every reader; fails where they are not the first packets."""
    for reader in ("dv-processing", "aedat", "faery"):
        done = subprocess.run(
            [sys.executable, ORACLES, reader, *paths],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        told = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        assert len(told) == len(paths)
        for facts in told:
            assert reader != "dv-processing" or facts["error"] == "", facts
            yield Path(facts["path"]), reader, digests.index(facts["digest"])
    for path in paths:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TornTailWarning)
            recording = read(path)
        summed = hashlib.sha256()
        for name in "txyp":
            summed.update(np.ascontiguousarray(recording[name]).tobytes())
        yield path, "evs", digests.index(summed.hexdigest())


@pytest.mark.parametrize("compression", ["none", "lz4"])
def test_a_kill_at_any_byte_leaves_every_whole_packet(
    tmp_path: Path, compression: str, digests: list[str]
) -> None:
    scope: dict[str, Any] = {}
    exec(RECORD, scope)  # noqa: S102 - as above
    scope["record"](tmp_path / "whole.aedat4", compression)
    size = (tmp_path / "whole.aedat4").stat().st_size
    offsets: list[tuple[int, int]] = []
    path = tmp_path / "open.aedat4"
    scope["record"](path, compression, lambda n: offsets.append((n, path.stat().st_size)))
    # the header's end, then that of every packet of any stream; not the table's
    ends = [size for _, size in offsets[:-1]]
    events_ends = [min(end for n, end in offsets if n == count) for count in range(1, PACKETS + 1)]
    # a tick's samples come before its events, after a frame if there is one
    imu_ends = [max(end for n, end in offsets if n == count) for count in range(PACKETS)]
    frame_ends = [min(e for n, e in offsets if n == q and e > events_ends[q - 1]) for q in FRAMES]
    # in the first and last packets, at their very ends, in the table
    limits = {ends[0] + 1, ends[0] + 8, ends[1] - 1, ends[1], ends[1] + 1, ends[-2] + 9}
    limits |= {frame_ends[0] - 1, frame_ends[0], frame_ends[-1] - 7, imu_ends[-1] - 1, imu_ends[-1]}
    limits |= {ends[-1] - 1, ends[-1], *range(ends[-1] + 1, size, 1 + (size - ends[-1]) // 7)}
    done = subprocess.run(
        [sys.executable, "-c", RECORD + AT_BYTE, tmp_path, compression, *map(str, sorted(limits))],
        capture_output=True,
        text=True,
        check=True,
    )
    dead = [int(code) for code in done.stdout.split()]
    assert len(dead) == len(limits)
    # SIGXFSZ, but for the one that ends where the file does
    assert set(dead) <= {-25, 0}
    assert dead.count(-25) >= len(limits) - 1
    paths = [tmp_path / f"{limit}.aedat4" for limit in sorted(limits)]
    for path, reader, count in everybody(paths, digests):
        limit = int(path.stem)
        assert path.stat().st_size == limit
        assert count == sum(end <= limit for end in events_ends), (limit, reader)
    for path in paths:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TornTailWarning)
            recording = read(path)
        limit = int(path.stem)
        assert len(recording.imu) == sum(end <= limit for end in imu_ends)
        assert recording.frames == tuple(
            scope["frame"](seq) for seq, end in zip(FRAMES, frame_ends, strict=True) if end <= limit
        )
        before = summary(path).events
        assert repair(path).cut_bytes == int(path.stem) - max(
            end for end in ends if end <= int(path.stem)
        )
        assert summary(path).events == before


RECORD_FILES = """
import itertools, os, sys
import numpy as np
from evs.drivers.files.aedat4 import Aedat4Recorder
from evs.msgs import EventPacket, StreamInfo, TriggerPacket, make_events, make_triggers

sink = Aedat4Recorder(sys.argv[1], sys.argv[2], rotate_mb=0.01)
sink.open([StreamInfo(346, 260, triggers=True)])
for seq in itertools.count():
    x = np.random.default_rng(seq).integers(0, 260, 120)
    t = np.sort(x) + 1000 * seq + 1
    sink.write_triggers(TriggerPacket(seq, make_triggers([(1000 * seq + 1, 1)])))
    sink.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, make_events(t, x, x, 1)))
    # one write of less than a page to a pipe is never torn
    os.write(1, f"{seq + 1}\\n".encode())
"""


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_after_kill_9_every_packet_of_every_file_is_read(tmp_path: Path, compression: str) -> None:
    random = np.random.default_rng()
    for run in range(4):
        path = tmp_path / f"run{run}.aedat4"
        process = subprocess.Popen(
            [sys.executable, "-c", RECORD_FILES, path, compression], stdout=subprocess.PIPE
        )
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(random.uniform(0.02, 0.1))
        process.kill()
        told = int(process.stdout.read().decode().split()[-1])
        process.wait()
        process.stdout.close()
        parts = [path, *later_parts(path)]
        assert len(parts) > 1
        # a file that was created in the very moment has no header yet, and nothing was written
        if parts[-1].stat().st_size < 100:
            del parts[-1]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TornTailWarning)
            recordings = [read(part, single=True) for part in parts]
        whole = join_events(recordings)
        count = len(whole) // 120
        assert told <= count <= told + 1
        for seq in (0, count // 2, count - 1):
            x = np.random.default_rng(seq).integers(0, 260, 120)
            wanted = make_events(np.sort(x) + 1000 * seq + 1, x, x, np.ones(120))
            assert whole[120 * seq : 120 * seq + 120].tobytes() == wanted.tobytes()
        triggers = np.concatenate([recording.triggers for recording in recordings])
        assert told <= len(triggers) <= told + 2
        assert (triggers["t"] == 1000 * np.arange(len(triggers)) + 1).all()
