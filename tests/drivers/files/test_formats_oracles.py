"""RAW, DAT, HDF5 and bags: other projects read ours bit-exactly, and we read theirs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.recording_file import by_tick
from evs.msgs import EventPacket, Events, StreamInfo, join_events, make_events
from reference.oracles import OracleProgram
from reference.streams import random_events

oracle = OracleProgram(Path(__file__).parents[2] / "support" / "oracles" / "foreign_oracles.py")
STREAM = StreamInfo(
    1280,
    720,
    camera="track é",
    sensor="imx636",
    seed=2**70,
    versions={"evs": "0.1.0"},
    config={"scene": {"file": 'a "b"\n% end\n.xml'}, "spp": [1, 2.5, None]},
    camera_info={"k": [300.0, 0, 173]},
)
KEEPS_STREAM = ("evt3", "evt2", "dat", "csv", "txt", "hdf5", "rosbag2", "rosbag1")


def seen(count: int, start_us: int, span_us: int) -> Events:
    return random_events(count, start_us - 1, start_us + span_us, (1280, 720))


CASES = {
    "many": seen(120_000, 0, 200_000),
    "long": seen(3000, 1, 60_000_000),
    "one": make_events([1], [1279], [719], [1]),
    "zero": make_events([0, 0], [0, 1279], [0, 719], [0, 1]),
    "2^24": seen(3000, 2**24 - 5000, 10_000),
    "2^31": seen(3000, 2**31 - 5000, 10_000),
    "2^32": seen(3000, 2**32 - 5000, 10_000),
    "packet": seen(65_535, 5_000_000_500, 400),
    "none": make_events([], [], [], []),
}
FORMATS = {
    "evt3": (".raw", "faery"),
    "evt2": (".raw", "faery"),
    "dat": (".dat", "faery"),
    "csv": (".csv", "faery"),
    "txt": (".txt", "eventcv"),
    "hdf5": (".h5", "h5py"),
    "rosbag1": (".bag", "rosbags"),
    "rosbag2": (".mcap", "rosbags"),
}


def record(path: Path, kind: str, events: Events, **options: str) -> dict[str, Any]:
    sink = files.recorder_for(path, kind=kind, **options)
    sink.open([STREAM])
    for seq, part in enumerate(by_tick(events, STREAM)):
        sink.write(EventPacket(seq, 0, 0, 1280, 720, part, STREAM.camera))
    said = sink.close()
    assert sink.close() == said
    return said


def cases(kind: str) -> Iterator[tuple[str, Events]]:
    for name, events in CASES.items():
        # a DAT reader cannot know that the first stamp has wrapped
        if kind != "dat" or not len(events) or events["t"][0] < 2**32:
            yield name, events


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_others_read_ours_bit_exactly_and_so_do_we(kind: str, tmp_path: Path) -> None:
    suffix, reader = FORMATS[kind]
    made = {}
    for name, events in cases(kind):
        path = tmp_path / f"{name}{suffix}"
        # the oracle knows no EVT3 in bags; test_encodings_codecs does
        said = record(path, kind, events, **({"encoding": "libcaer"} if suffix == ".mcap" else {}))
        assert said["events"] == len(events)
        assert said["bytes"] == path.stat().st_size
        recording = files.read(path)
        assert recording.tobytes() == events.tobytes()
        if kind in KEEPS_STREAM:
            assert recording.stream == STREAM
        assert (recording.stream.width, recording.stream.height) == (1280, 720) or not len(events)
        summary = files.summary(path)
        assert (summary.format, summary.events, summary.torn_at) == (kind, len(events), None)
        assert summary.packets == len(list(by_tick(events, STREAM)))
        made[str(path)] = events
    left = {path.name for path in tmp_path.iterdir() if path.suffix != ".json"}
    assert left == {Path(path).name for path in made}
    seen = oracle(reader, *made)
    assert len(seen) == len(made) > 7
    for facts in seen:
        events = made[facts["path"]]
        assert facts["events"] == len(events), facts
        assert facts["digest"] == oracle.digest(events), facts
        assert facts.get("size", [1280, 720]) == [1280, 720]
        if kind == "hdf5":
            assert facts["wrong"] == 0
            assert facts["integer"]
        if kind == "rosbag1":
            assert facts["topics"][0] == "/dvs/events dvs_msgs/msg/EventArray"
        if kind == "rosbag2":
            packet = "event_camera_msgs/msg/EventPacket"
            assert f"/track/events {packet}" in facts["topics"]
            assert facts["seq"] == list(range(len(facts["seq"])))


@pytest.mark.integration
@pytest.mark.parametrize("kind", ["rosbag1", "rosbag2"])
@pytest.mark.parametrize("encoding", ["evt3", "mono", "dvs"])
def test_bags_of_any_encoding(kind: str, encoding: str, tmp_path: Path) -> None:
    suffix = FORMATS[kind][0]
    for name in ("many", "2^32", "packet"):
        path = tmp_path / f"{name}{suffix}"
        record(path, kind, CASES[name], encoding=encoding)
        recording = files.read(path)
        assert recording.tobytes() == CASES[name].tobytes()
        assert recording.stream == STREAM
    (facts,) = oracle("rosbags", path)
    if encoding == "evt3":
        assert set(facts["encodings"]) == {"evt3"}
    else:
        assert facts["digest"] == oracle.digest(CASES["packet"])
        assert facts["frame_id"] == "track_optical_frame"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["evt2", "evt3", "dat", "rpg", "dsec"])
def test_we_read_what_others_wrote(kind: str, tmp_path: Path) -> None:
    suffix = {"dat": ".dat", "rpg": ".hdf5", "dsec": ".h5"}.get(kind, ".raw")
    for name in ("many", "long", "2^24"):
        events = CASES[name]
        np.save(tmp_path / "events.npy", np.asarray(events))
        path = tmp_path / f"{name}{suffix}"
        oracle("write", kind, path, tmp_path / "events.npy")
        recording = files.read(path)
        # their EVT3 begins to count where the first event is
        shift = int(events["t"][0] - recording["t"][0]) if kind == "evt3" else 0
        assert shift in (0, 2**24)
        recording["t"] += shift
        assert recording.tobytes() == events.tobytes()
        assert (recording.stream.width, recording.stream.height) == (1280, 720)


def test_packets_are_the_ticks_that_were_recorded(tmp_path: Path) -> None:
    events = CASES["many"]
    for kind, (suffix, _) in FORMATS.items():
        path = tmp_path / f"run{suffix}"
        record(path, kind, events)
        packets = list(files.packets(path))
        assert join_events([packet.events for packet in packets]).tobytes() == events.tobytes()
        for packet, part in zip(packets, by_tick(events, STREAM), strict=True):
            assert packet.events.tobytes() == part.tobytes()
            assert packet.time_end_us == -(-int(part["t"][0]) // 1000) * 1000
