"""NPZ recordings: written whole or not at all, read from anybody, refused where damaged."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.files import packets, read, recorder_for, repair, summary
from evs.drivers.files.integrity import BackwardsWarning
from evs.drivers.files.npz import NpzRecorder
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, join_events, make_events
from reference.streams import random_events

STREAM = StreamInfo(
    346, 260, camera="eye", sensor="davis346", seed=2**70, config={"a": [1]}, versions={"evs": "1"}
)


def events_of(tick: int, count: int = 100) -> Events:
    return random_events(count, 1000 * tick, 1000 * tick + 1000, seed=tick)


def record(path: Path, ticks: list[int]) -> dict[str, Any]:
    sink = recorder_for(path)
    sink.open([STREAM])
    for tick in ticks:
        sink.write(EventPacket(tick, 0, 0, 346, 260, events_of(tick)))
    return sink.close()


def test_it_is_plain_numpy_to_others(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    said = record(path, [0, 1, 5])
    assert (said["type"], said["packets"], said["events"]) == ("npz", 3, 300)
    assert said["bytes"] == path.stat().st_size
    whole = join_events([events_of(tick) for tick in (0, 1, 5)])
    with np.load(path, allow_pickle=False) as arrays:
        assert sorted(arrays) == ["p", "stream", "t", "x", "y"]
        for name in "txyp":
            assert arrays[name].dtype == whole.dtype[name]
            assert np.array_equal(arrays[name], whole[name])
    assert [file.name for file in tmp_path.iterdir()] == ["a.npz"]


def test_it_comes_back_with_its_stream_tick_by_tick(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    record(path, [0, 1, 5])
    recording = read(path)
    assert recording.tobytes() == join_events([events_of(k) for k in (0, 1, 5)]).tobytes()
    assert recording.stream == STREAM
    found = list(packets(path))
    assert [packet.time_end_us for packet in found] == [1000, 2000, 6000]
    assert found[2].events.tobytes() == events_of(5).tobytes()
    told = summary(path)
    assert (told.events, told.packets, told.compression) == (300, 3, "deflate")
    assert not repair(path).needed


def test_an_old_recording_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    path.write_bytes(b"old")
    sink = NpzRecorder(path)
    assert sink.close() == {}
    with pytest.raises(EvsError, match="not open"):
        sink.write(EventPacket(0, 0, 1, 346, 260))
    sink.open([STREAM])
    sink.write(EventPacket(0, 0, 1000, 346, 260, events_of(0)))
    assert path.read_bytes() == b"old"
    said = sink.close()
    assert sink.close() == said
    assert len(read(path)) == 100


def test_packets_may_reuse_their_memory(tmp_path: Path) -> None:
    sink = NpzRecorder(tmp_path / "a.npz")
    sink.open([STREAM])
    events = events_of(0)
    sink.write(EventPacket(0, 0, 1000, 346, 260, events))
    events["x"] = 0
    sink.close()
    assert read(tmp_path / "a.npz")["x"].tolist() == events_of(0)["x"].tolist()


def test_an_empty_recording_comes_back(tmp_path: Path) -> None:
    record(tmp_path / "a.npz", [])
    assert len(read(tmp_path / "a.npz")) == 0
    assert list(packets(tmp_path / "a.npz")) == []
    assert read(tmp_path / "a.npz").stream == STREAM


FULL_DISK = """
import resource, sys
import numpy as np
from evs.drivers.files.npz import NpzRecorder
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events

resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)
sink = NpzRecorder(sys.argv[1])
x = np.random.default_rng(0).integers(0, 260, 300_000)
t = np.cumsum(np.random.default_rng(1).integers(0, 2**40, len(x)))
written = 0
try:
    sink.open([StreamInfo(346, 260)])
    for k in range(0, len(x), 1000):
        part = x[k : k + 1000]
        events = make_events(t[k : k + 1000], part, part, part % 2)
        sink.write(EventPacket(k, 0, 0, 346, 260, events))
        written += 1000
except EvsError as error:
    print(error)
assert sink.close().get("events", 0) == written
print(written)
"""


@pytest.mark.integration
def test_a_full_disk_is_noticed_while_recording_and_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, path, "4000000"],
        capture_output=True,
        text=True,
        check=True,
    )
    said, written = done.stdout.splitlines()
    assert "stopped after" in said
    assert "they are kept" in said
    assert len(read(path)) == int(written) > 100_000
    assert [file.name for file in tmp_path.iterdir()] == ["a.npz"]
    # and where not even the first byte fits, nothing is left behind
    path.unlink()
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, path, "1000"], capture_output=True, text=True, check=True
    )
    assert "cannot write" in done.stdout
    assert list(tmp_path.iterdir()) == []


def saved(path: Path, **arrays: Any) -> Path:
    np.savez(path, **arrays)
    return path


def test_arrays_of_other_people_are_read(tmp_path: Path) -> None:
    path = saved(
        tmp_path / "a.npz",
        t=np.array([5, 5, 9], np.uint32),
        x=np.array([1, 2, 600]),
        y=np.array([0, 4, 3], np.uint8),
        p=np.array([True, False, True]),
        frames=np.zeros((2, 3)),
    )
    recording = read(path)
    assert (
        recording.tobytes() == make_events([5, 5, 9], [1, 2, 600], [0, 4, 3], [1, 0, 1]).tobytes()
    )
    assert recording.stream == StreamInfo(601, 5, sensor="unknown")
    signs = saved(tmp_path / "b.npz", t=[1, 2], x=[0, 0], y=[0, 0], p=[-1, 1])
    assert read(signs)["p"].tolist() == [0, 1]


def test_stamps_out_of_order_are_sorted_and_told(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.npz", t=[4, 9, 7, 8], x=[1, 2, 3, 4], y=[0] * 4, p=[1] * 4)
    with pytest.warns(BackwardsWarning, match="2 time stamps .* sorted; the first at event 2"):
        recording = read(path)
    assert recording[["t", "x"]].tolist() == [(4, 1), (7, 3), (8, 4), (9, 2)]


@pytest.mark.slow
def test_a_long_recording_passes_through_little_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    count, tick = 1_000_000, 10_000
    tracemalloc.start()
    sink = recorder_for(path)
    # as a run records it: in order, so that nothing waits for late events
    sink.open([replace(STREAM, versions={"evs": "0"})])
    for begin in range(0, count, tick):
        t = np.arange(begin, begin + tick)
        sink.write(EventPacket(0, 0, 0, 346, 260, make_events(t, t % 346, t % 260, t % 2)))
    sink.close()
    assert sum(len(packet) for packet in packets(path)) == count
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # 16 MB of events; four spools of 1 MB at most, and pieces of 65,536 events
    assert peak < 10e6


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"t": None}, "needs arrays t, x, y, p, .* it has x, y, p"),
        ({"t": np.array([1.5, np.nan])}, "too large"),
        ({"t": np.array([[1, 2]])}, "needs arrays t, x, y, p"),
        ({"t": np.array([1, 2**63], np.uint64)}, "too large|backwards"),
        ({"t": [2, 1], "cause": np.array([1, 1], np.uint8), "geom_id": [0, 0]}, "run backwards"),
        ({"x": np.array([1])}, "not of one length"),
        ({"x": np.array([0, 70_000])}, "too large"),
        ({"y": np.array([-1, 0])}, "too small"),
        ({"p": np.array(["a", "b"])}, "needs arrays t, x, y, p"),
        ({"p": np.array([{}, {}], object)}, "needs arrays t, x, y, p|cannot read"),
        ({"p": np.array([1, 2])}, "polarity is unknown"),
    ],
)
def test_other_arrays_are_refused_in_one_line(
    tmp_path: Path, change: dict[str, Any], says: str
) -> None:
    given: dict[str, Any] = {"t": [1, 2], "x": [0, 1], "y": [0, 1], "p": [0, 1]} | change
    path = saved(
        tmp_path / "a.npz", **{key: value for key, value in given.items() if value is not None}
    )
    with pytest.raises(EvsError, match=says) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_an_array_that_states_more_than_it_holds_allocates_nothing(tmp_path: Path) -> None:
    good = saved(tmp_path / "a.npz", t=np.arange(2), x=[0, 1], y=[0, 1], p=[0, 1])
    with zipfile.ZipFile(good) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["t.npy"] = members["t.npy"].replace(b"(2,), }        ", b"(2222222222,), }")
    assert b"2222222222" in members["t.npy"]
    with zipfile.ZipFile(good, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    with pytest.raises(EvsError, match="array 't' is not of the size that it states"):
        read(good)
