"""A recording in several files: where it is cut, that nothing is lost, what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.files import read, summary
from evs.drivers.files.aedat4 import Aedat4File, Aedat4Recorder
from evs.drivers.files.multi_file import later_parts, part_path
from evs.drivers.sink import SinkStoppedError
from evs.msgs import (
    EventPacket,
    EvsError,
    Frame,
    StreamInfo,
    TriggerPacket,
    frame_triggers,
    join_events,
)
from reference.streams import random_packet

STREAM = StreamInfo(346, 260, camera="eye", frames=True, triggers=True, seed=5)


def record(path: Path, packets: list[EventPacket], compression: str, **rotation: float) -> object:
    sink = Aedat4Recorder(path, compression, **rotation)
    sink.open([STREAM])
    for one in packets:
        sink.write(one)
    return sink.close()["files"] if rotation else 0


def parts_of(path: Path) -> list[Path]:
    return [path, *later_parts(path)]


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@pytest.mark.parametrize("rotate_mb", [0.02, 0.05, 0.15])
def test_no_file_grows_over_its_size_and_nothing_is_lost(
    tmp_path: Path, compression: str, rotate_mb: float
) -> None:
    path = tmp_path / "run.aedat4"
    packets = [random_packet(seq, 1 + 53 * seq % 400) for seq in range(200)]
    count = record(path, packets, compression, rotate_mb=rotate_mb)
    parts = parts_of(path)
    assert len(parts) == count > 1
    assert [part.name for part in parts[:2]] == ["run.aedat4", "run-001.aedat4"]
    whole = join_events([read(part, single=True) for part in parts])
    assert whole.tobytes() == join_events([one.events for one in packets]).tobytes()
    for number, part in enumerate(parts):
        file = Aedat4File.at(part)
        assert part.stat().st_size <= 1e6 * rotate_mb
        # and each is whole in itself
        assert file.stream == STREAM
        assert (file.table_packets is not None) == (compression != "none")
        assert json.loads(file.declared[0].info["part"]) == number


def test_a_single_packet_over_the_size_has_a_file_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat4"
    packets = [random_packet(0, 10), random_packet(1, 5000), random_packet(2, 10)]
    assert record(path, packets, "none", rotate_mb=0.01) == 3
    assert [len(read(part, single=True)) for part in parts_of(path)] == [10, 5000, 10]


def test_a_file_ends_with_the_tick_that_ends_its_time(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat4"
    # the camera starts late; nothing is seen from tick 60 to 95
    packets = [random_packet(seq, 0 if 60 <= seq < 95 else 5) for seq in range(3, 120)]
    record(path, packets, "lz4", rotate_s=0.02)
    stamps = [read(part, single=True)["t"] for part in parts_of(path)]
    assert [int(-(-t[0] // 1000)) - 1 for t in stamps] == [3, 23, 43, 95, 103]
    assert [int(-(-t[-1] // 1000)) - 1 for t in stamps] == [22, 42, 59, 102, 119]


def test_frames_and_triggers_go_into_the_file_of_their_tick(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat4"
    sink = Aedat4Recorder(path, rotate_s=0.01)
    sink.open([STREAM])
    frames = []
    for seq in range(40):
        if seq % 4 == 3:
            begin = 1000 * seq - 2000
            image = np.full((260, 346), seq, np.uint8)
            stamps = begin, begin, begin + 1500, begin + 2500
            frames.append(Frame(len(frames), *stamps, image, "eye"))
            sink.write_frame(frames[-1])
            sink.write_triggers(TriggerPacket(len(frames) - 1, frame_triggers(frames[-1]), "eye"))
        sink.write(random_packet(seq, 3))
    said = sink.close()
    assert (said["files"], said["frames"], said["triggers"]) == (4, 10, 40)
    found = [read(part, single=True) for part in parts_of(path)]
    assert [len(part.frames) for part in found] == [2, 3, 2, 3]
    assert [len(part.triggers) for part in found] == [8, 12, 8, 12]
    pixels = [frame.pixels[0, 0] for part in found for frame in part.frames]
    assert pixels == [frame.pixels[0, 0] for frame in frames]


def test_parts_of_an_earlier_recording_are_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat4"
    old = tmp_path / "run-002.aedat4"
    old.write_bytes(b"old")
    with pytest.raises(EvsError, match=r"run-002\.aedat4 of an earlier recording .*move them"):
        record(path, [random_packet(0, 3)], "lz4", rotate_mb=1)
    assert not path.exists()
    # other names are nobody's parts
    for name in ("run-2.aedat4", "run-02.aedat4", "other-002.aedat4", "run-002.npz"):
        old.rename(tmp_path / name)
        old = tmp_path / name
        record(path, [random_packet(0, 3)], "lz4", rotate_mb=1)
        assert old.read_bytes() == b"old"


def test_a_file_that_comes_up_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat4"
    sink = Aedat4Recorder(path, "none", rotate_mb=0.005)
    sink.open([STREAM])
    sink.write(random_packet(0, 100))
    part_path(path, 1).write_bytes(b"somebody's")
    with pytest.raises(SinkStoppedError, match=r"run-001\.aedat4 already exists"):
        sink.write(random_packet(1, 200))
    assert part_path(path, 1).read_bytes() == b"somebody's"
    assert summary(path).events == sink.close()["events"] > 0


def test_a_recording_without_events_is_one_file(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat4"
    assert record(path, [random_packet(seq, 0) for seq in range(50)], "lz4", rotate_s=0.01) == 1
    assert len(read(path)) == 0


@pytest.mark.parametrize("rotation", [{"rotate_mb": -1.0}, {"rotate_s": float("nan")}])
def test_impossible_limits_are_refused(tmp_path: Path, rotation: dict[str, float]) -> None:
    with pytest.raises(EvsError, match="give a number over 0"):
        Aedat4Recorder(tmp_path / "a.aedat4", **rotation)
