"""Aedat4Recorder: what it writes and when, what it refuses, and a disk that fills up."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.files import read, summary
from evs.drivers.files.aedat4 import Aedat4File, Aedat4Recorder, recorder
from evs.msgs import EventPacket, EvsError, StreamInfo, empty_events, make_events

STREAM = StreamInfo(346, 260, camera="eye")


def packet(seq: int, count: int) -> EventPacket:
    t = np.linspace(1000 * seq + 1, 1000 * seq + 1000, count).astype(np.int64)
    x = np.random.default_rng(seq).integers(0, 346, count)
    return EventPacket(
        seq, 1000 * seq, 1000 * seq + 1000, 346, 260, make_events(t, x, x % 260, x % 2)
    )


def test_nothing_is_touched_before_open_and_close_is_safe_without_it(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    path.write_bytes(b"old")
    sink = Aedat4Recorder(path)
    with pytest.raises(EvsError, match="not open"):
        sink.write(packet(0, 1))
    assert sink.close() == sink.close()
    assert path.read_bytes() == b"old"
    sink.open([STREAM])
    assert sink.close()["events"] == 0
    assert len(read(path)) == 0


def test_every_packet_is_in_the_file_when_write_returns(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    sink = Aedat4Recorder(path)
    sink.open([STREAM])
    total = 0
    for seq, count in enumerate((5, 0, 1, 3000)):
        sink.write(packet(seq, count))
        total += count
        assert len(read(path)) == total
    said = sink.close()
    assert sink.close() == said
    # the tick without events left no packet
    assert (said["packets"], said["empty_ticks"], said["events"]) == (3, 1, 3006)
    assert said["bytes"] == path.stat().st_size
    assert Aedat4File.at(path).table_packets == 3


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_compressed_file_always_gets_its_table(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "a.aedat4"
    for count in [*range(1, 60), 700]:
        sink = Aedat4Recorder(path, compression)
        sink.open([STREAM])
        for seq in range(count):
            sink.write(packet(seq, 1 + seq % 7))
        end = path.stat().st_size
        assert sink.close()["table"]
        data = path.read_bytes()
        assert recorder._looks_torn(data[end:])
        file = Aedat4File.at(path)
        assert (file.table_packets, file.packets_end, file.end) == (count, end, len(data))


def test_a_tick_of_very_many_events_becomes_several_packets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "MAX_PACKET_EVENTS", 1000)
    path = tmp_path / "a.aedat4"
    sink = Aedat4Recorder(path)
    sink.open([STREAM])
    whole = packet(0, 2500)
    sink.write(whole)
    assert sink.close()["packets"] == 3
    assert read(path).tobytes() == whole.events.tobytes()


def test_a_recording_of_too_many_packets_has_no_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "MAX_TABLE_PACKETS", 5)
    path = tmp_path / "a.aedat4"
    for count, table in ((5, True), (6, False)):
        sink = Aedat4Recorder(path)
        sink.open([STREAM])
        for seq in range(count):
            sink.write(packet(seq, 2))
        assert sink.close()["table"] is table
        assert len(read(path)) == 2 * count


def test_packing_is_told_from_writing(tmp_path: Path) -> None:
    laps: list[str] = []

    class Watch:
        def lap(self, stage: str) -> None:
            laps.append(stage)

    sink = Aedat4Recorder(tmp_path / "a.aedat4")
    sink.meter = Watch()
    sink.open([STREAM])
    sink.write(packet(0, 3))
    sink.close()
    assert laps == ["pack"]


def test_a_side_that_no_event_can_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match=r"each side must be 1 \.\.\. 32768"):
        Aedat4Recorder(tmp_path / "a.aedat4").open([StreamInfo(5, 40_000)])
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_compression_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(EvsError, match="there is: zstd"):
        Aedat4Recorder("a.aedat4", "zst")


FULL_DISK = """
import resource, sys
from evs.drivers.files import recorder_for
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events
import numpy as np

# a file size limit is what a full disk is to a process: a short write, then an error
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]),) * 2)
sink = recorder_for(sys.argv[1], sys.argv[2])
x = np.random.default_rng(0).integers(0, 260, (1000, 700))
written = 0
try:
    sink.open([StreamInfo(346, 260)])
    for k in range(1000):
        t = np.sort(x[k]) + 1000 * k + 1
        sink.write(EventPacket(k, 0, 0, 346, 260, make_events(t, x[k], x[k], x[k] % 2)))
        written += 1
except EvsError as error:
    try:
        sink.write(EventPacket(0, 0, 0, 346, 260, make_events([1], [1], [1], [1])))
    except EvsError as again:
        assert str(again) == str(error)
    said = sink.close()
    assert said["events"] == 700 * written, said
    print(error)
    sys.exit(written % 251 + 1)
sink.close()
"""


@pytest.mark.integration
@pytest.mark.parametrize("limit", [100_000, 100_001, 123_457])
@pytest.mark.parametrize(
    ("name", "compression"), [("a.aedat4", "none"), ("a.aedat4", "lz4"), ("a.aedat4", "zstd")]
)
def test_a_full_disk_ends_the_recording_with_one_line_and_loses_nothing(
    tmp_path: Path, name: str, compression: str, limit: int
) -> None:
    path = tmp_path / name
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, path, compression, str(limit)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    assert done.stdout.count("\n") == 1
    assert "stopped after" in done.stdout
    found = summary(path)
    assert found.events == 700 * (done.returncode - 1) > 0
    assert (found.torn_at, found.damaged_packets) == (None, 0)
    assert path.stat().st_size <= limit


HEADER_ONLY = """
import resource, sys
from evs.drivers.files.aedat4 import Aedat4Recorder
from evs.msgs import EvsError, StreamInfo

resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
sink = Aedat4Recorder(sys.argv[1])
try:
    sink.open([StreamInfo(346, 260)])
except EvsError as error:
    print(error)
print(sink.close()["events"])
"""


def test_a_disk_too_full_for_the_header_is_told(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", HEADER_ONLY, tmp_path / "a.aedat4"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    said, events = done.stdout.splitlines()
    assert "a.aedat4: File too large; choose a place" in said
    assert events == "0"


def test_no_room_for_the_table_costs_only_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.aedat4"
    sink = Aedat4Recorder(path)
    sink.open([STREAM])
    for seq in range(9):
        sink.write(packet(seq, 10))
    size = path.stat().st_size

    def full(file: int, parts: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "writev", full)
    said = sink.close()
    assert (said["table"], said["error"], said["events"]) == (False, "", 90)
    assert path.stat().st_size == size
    assert len(read(path)) == 90


def test_empty_events_alone_make_an_empty_recording(tmp_path: Path) -> None:
    sink = Aedat4Recorder(tmp_path / "a.aedat4")
    sink.open([STREAM])
    sink.write(EventPacket(0, 0, 1000, 346, 260, empty_events()))
    assert sink.close()["packets"] == 0
    found = summary(tmp_path / "a.aedat4")
    assert (found.events, found.packets, found.rate_hz) == (0, 0, None)


def test_a_device_without_room_is_told_by_name(tmp_path: Path) -> None:
    target = tmp_path / "full.aedat4"
    target.symlink_to("/dev/full")
    with pytest.raises(EvsError, match=r"full\.aedat4: No space left"):
        Aedat4Recorder(target).open([STREAM])
