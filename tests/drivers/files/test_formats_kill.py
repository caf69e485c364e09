"""A recorder that is killed leaves what it wrote, as readers can read it: one matrix of formats."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.msgs import Events, join_events, make_events
from reference.oracles import OracleProgram

pytestmark = pytest.mark.extremes

ORACLES = Path(__file__).parents[2] / "support" / "oracles"
oracle = OracleProgram(ORACLES / "foreign_oracles.py")
aedat4 = OracleProgram(ORACLES / "aedat4_oracles.py")

SLOW = pytest.mark.slow
PACKETS = 4000
COUNT = 40
RECORD = f"""
import os, sys
import numpy as np
from evs.drivers import files
from evs.msgs import EventPacket, Frame, ImuPacket, StreamInfo, empty_imu, make_events

def packet(seq):
    random = np.random.default_rng(seq)
    t = np.sort(random.integers(1000 * seq + 1, 1000 * seq + 1001, {COUNT}))
    x, y = random.integers(0, 346, {COUNT}), random.integers(0, 260, {COUNT})
    return make_events(t, x, y, t % 2)

path, options = sys.argv[1], {{}}
if path.endswith((".mcap", ".db3", ".bag")):
    options = {{"encoding": "libcaer" if not path.endswith(".bag") else "dvs"}}
sink = files.recorder_for(path, **options)
beside = hasattr(sink, "write_frame")
sink.open([StreamInfo(346, 260, camera="eye", frames=beside, imu=beside)])
for seq in range({PACKETS}):
    if beside and seq % 50 == 1:
        at = 1000 * seq
        sink.write_frame(Frame(seq // 50, at, at, at, at, np.full((4, 6), seq % 256, np.uint8)))
        samples = empty_imu(1)
        samples["t"] = at
        sink.write_imu(ImuPacket(seq, samples))
    sink.write(EventPacket(seq, 0, 0, 346, 260, packet(seq)))
    os.write(1, b"%d\\n" % seq)
# one that is to be killed waits here, however late the kill comes
sys.stdin.read()
sink.close()
os.write(1, b"closed\\n")
"""
BAGS = ("a.mcap", "a.db3", "a.bag")
LOSSES = {
    "a.aedat4": 0,
    "a.aedat": 0,
    "a.aedat3": 0,
    "a.csv": 0,
    "a.dat": 0,
    "a.raw": 0,
    "a.h5": 65_536 // COUNT,
    "a.hdf5": 16_384 // COUNT,
}
LOSSES |= dict.fromkeys(BAGS, 100)
"""Of how many packets, 1 ms each, the last may be lost at most."""
READERS = {
    "a.aedat4": ("dv-processing", "aedat", "faery"),
    "a.dat": ("faery",),
    "a.h5": ("h5py",),
    **dict.fromkeys(BAGS, ("rosbags",)),
}


def events(seq: int) -> Events:
    random = np.random.default_rng(seq)
    t = np.sort(random.integers(1000 * seq + 1, 1000 * seq + 1001, COUNT))
    x, y = random.integers(0, 346, COUNT), random.integers(0, 260, COUNT)
    return make_events(t, x, y, t % 2)


@pytest.fixture(scope="module")
def whole() -> Events:
    return join_events([events(seq) for seq in range(PACKETS)])


def killed(path: Path, after: int) -> int:
    """Kill -9 the recorder when it has said that so many packets are written; how many were."""
    program = [sys.executable, "-c", RECORD, path]
    process = subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stdout is not None
    said = b""
    while f"{after}\n".encode() not in said:
        more = os.read(process.stdout.fileno(), 4096)
        assert more, "the recorder ended"
        said += more
    process.send_signal(signal.SIGKILL)
    said += process.stdout.read()
    process.wait()
    process.stdin.close()
    process.stdout.close()
    assert b"closed" not in said
    return int(said.split()[-1]) + 1


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("after", [99, *(pytest.param(n, marks=SLOW) for n in (0, 1733, 3210))])
def test_what_was_written_before_a_kill_is_read(
    name: str, after: int, tmp_path: Path, whole: Events
) -> None:
    path = tmp_path / name
    written = killed(path, after)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        recording = files.read(path)
        found = files.summary(path)
        frames, samples = recording.frames, recording.imu
    hdf5 = name in ("a.h5", "a.hdf5")
    assert len(recording) % COUNT == 0 or hdf5
    assert len(recording) >= COUNT * max(0, written - LOSSES[name])
    assert recording.tobytes() == whole[: len(recording)].tobytes()
    if recording.stream.frames:
        # those of whole packets are there; a tick's frame may be kept, and its samples not yet
        due = len(range(1, written - LOSSES[name], 50))
        assert due <= len(samples) <= len(frames) <= len(samples) + 1
        assert found.frames == len(frames)
    # nothing but the recording is left, and a journal that is taken back
    left = {one.name for one in tmp_path.iterdir()} - {"a.csv.json"}
    assert left <= {name, f"{name}-journal"}
    # a bag and an HDF5 file always lack their end
    lacks_end = hdf5 or name in ("a.mcap", "a.bag")
    assert found.unfinished == lacks_end
    assert files.repair(path).needed or not lacks_end
    assert not files.repair(path).needed
    assert {one.name for one in tmp_path.iterdir()} - {"a.csv.json"} == {name}
    after_all = files.summary(path)
    assert (after_all.torn_at, after_all.unfinished) == (None, False)
    again = files.read(path)
    assert again.tobytes() == recording.tobytes()
    assert again.frames == frames
    for reader in READERS.get(name, ()):
        asked = aedat4 if name == "a.aedat4" else oracle
        (facts,) = asked(reader, path)
        assert facts["events"] >= len(recording)
        if name != "a.h5":
            assert facts["digest"] == asked.digest(recording)


@SLOW
@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_a_torn_bag_is_repaired_at_any_byte(name: str, tmp_path: Path, whole: Events) -> None:
    killed(tmp_path / name, 500)
    data = (tmp_path / name).read_bytes()
    random = np.random.default_rng(1)
    places = {*random.integers(6000, len(data), 25).tolist(), len(data) - 1, len(data) - 9}
    paths = [tmp_path / f"{place}-{name}" for place in sorted(places)]
    digests = []
    for place, path in zip(sorted(places), paths, strict=True):
        path.write_bytes(data[:place])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            before = files.read(path)
        files.repair(path)
        after = files.read(path)
        assert after.tobytes() == before.tobytes() == whole[: len(before)].tobytes()
        digests.append(oracle.digest(after))
        assert not files.repair(path).needed
    assert [facts["digest"] for facts in oracle("rosbags", *paths)] == digests


@pytest.mark.parametrize("name", ["a.h5", "a.hdf5", "a.mcap", "a.bag", "a.db3"])
def test_a_closed_file_needs_no_repair(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    subprocess.run(
        [sys.executable, "-c", RECORD.replace(str(PACKETS), "300"), path],
        check=True,
        stdin=subprocess.DEVNULL,
        capture_output=True,
    )
    data = path.read_bytes()
    assert not files.repair(path).needed
    assert path.read_bytes() == data
    assert [one.name for one in tmp_path.iterdir()] == [name]
