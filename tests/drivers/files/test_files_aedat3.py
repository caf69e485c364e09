"""AEDAT3.1: packets, the overflow counter, and damage between them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.integrity import BackwardsWarning, DamagedPacketWarning, TornTailWarning
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events

STREAM = StreamInfo(346, 260, camera="eye", sensor="davis346", seed=9, config={"a": [1]})
HEADER = (
    b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS346\r\n"
    b"#Start-Time: 2017-01-01 10:00:00 (TZ+0100)\r\n#!END-HEADER\r\n"
)
Event = tuple[int, int, int, int]


def packet(*events: Event, overflow: int = 0, valid: int = 1) -> bytes:
    """A polarity packet of (stamp, x, y, p), by hand."""
    count = len(events)
    head = struct.pack("<hhiiiiii", 1, 1, 8, 4, overflow, count, count, count * valid)
    body = b"".join(
        struct.pack("<Ii", x << 17 | y << 2 | p << 1 | valid, t) for t, x, y, p in events
    )
    return head + body


def other(kind: int, size: int, count: int) -> bytes:
    """A packet of another kind."""
    return struct.pack("<hhiiiiii", kind, 1, size, 4, 0, count, count, count) + bytes(size * count)


def written(path: Path, *packets: bytes) -> Path:
    path.write_bytes(HEADER + b"".join(packets))
    return path


def test_the_bytes_are_the_formats(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat3"
    sink = files.recorder_for(path)
    sink.open([STREAM])
    events = make_events([5, 6], [1, 345], [2, 259], [1, 0])
    sink.write(EventPacket(0, 0, 1000, 346, 260, events, "eye"))
    wrap = 1 << 31
    across = make_events([wrap - 1, wrap, 2 * wrap], [0, 1, 2], [0, 1, 2], [1, 1, 1])
    sink.write(EventPacket(1, 0, 1000, 346, 260, across, "eye"))
    assert sink.close()["events"] == 5
    header, _, rest = path.read_bytes().partition(b"#!END-HEADER\r\n")
    assert header.startswith(b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS346\r\n")
    assert rest == packet((5, 1, 2, 1), (6, 345, 259, 0)) + packet((wrap - 1, 0, 0, 1)) + packet(
        (0, 1, 1, 1), overflow=1
    ) + packet((0, 2, 2, 1), overflow=2)
    got = files.read(path)
    assert got["t"].tolist() == [5, 6, wrap - 1, wrap, 2 * wrap]
    assert got.stream == STREAM


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    sink = files.recorder_for(tmp_path / "a.aedat3")
    sink.open([STREAM])
    with pytest.raises(EvsError, match=r"event at -1 us to .*; AEDAT3\.1 holds 0 \.\.\."):
        sink.write(EventPacket(0, -2, 0, 346, 260, make_events([-1], [1], [1], [1])))
    sink.close()


def test_packets_of_other_kinds_and_what_is_marked_invalid_are_counted(tmp_path: Path) -> None:
    whole = [packet((1, 1, 1, 1)), other(2, 100, 1), other(3, 36, 5), other(0, 8, 2)]
    path = written(
        tmp_path / "a.aedat3", *whole, packet((2, 1, 1, 1), valid=0), packet((3, 2, 2, 0))
    )
    assert files.read(path).tolist() == [(1, 1, 1, 1), (3, 2, 2, 0)]
    found = files.summary(path)
    assert found.left_out == {
        "invalid frames": 1,
        "invalid IMU samples": 5,
        "special events": 2,
        "invalid events": 1,
    }
    assert (found.stream.width, found.stream.height) == (346, 260)


def test_bytes_between_packets_are_told_and_passed(tmp_path: Path) -> None:
    first = packet((1, 1, 1, 1))
    path = written(tmp_path / "a.aedat3", first, b"garbage" * 3, packet((2, 1, 1, 1)))
    at = len(HEADER) + len(first)
    with pytest.warns(DamagedPacketWarning, match=f"1 damaged packets .* at byte {at}: no packet"):
        assert files.read(path)["t"].tolist() == [1, 2]


def test_the_whole_events_of_a_torn_packet_are_read(tmp_path: Path) -> None:
    whole = packet((1, 1, 1, 1), (2, 1, 1, 1), (3, 1, 1, 1))
    later = packet((4, 1, 1, 1), (5, 1, 1, 1), (6, 1, 1, 1))
    path = written(tmp_path / "a.aedat3", whole, later[:-5])
    end = len(HEADER) + len(whole) + 28 + 16
    with pytest.warns(TornTailWarning, match=f"3 bytes at offset {end} "):
        assert files.read(path)["t"].tolist() == [1, 2, 3, 4, 5]
    for cut in (20, 1):
        written(path, whole, later[:cut])
        with pytest.warns(TornTailWarning, match=f"{cut} bytes at offset {len(HEADER + whole)} "):
            assert files.read(path)["t"].tolist() == [1, 2, 3]
        assert files.repair(path).cut_bytes == cut
        assert path.read_bytes() == HEADER + whole


def test_events_outside_the_sensor_are_damage(tmp_path: Path) -> None:
    path = written(tmp_path / "a.aedat3", packet((1, 1, 1, 1), (2, 346, 1, 1), (3, 1, 260, 1)))
    at = len(HEADER) + 28 + 8
    said = rf"2 damaged events .* at byte {at}: an event at \(346, 1\)"
    with pytest.warns(DamagedPacketWarning, match=said):
        assert files.read(path)["t"].tolist() == [1]


def test_packets_in_the_wrong_order_are_sorted(tmp_path: Path) -> None:
    late = [packet((30, 1, 1, 1), (50, 1, 1, 1)), packet((20, 2, 2, 1), (40, 2, 2, 1))]
    path = written(tmp_path / "a.aedat3", *late)
    with pytest.warns(BackwardsWarning, match="2 time stamps ran backwards"):
        assert files.read(path)["t"].tolist() == [20, 30, 40, 50]


def test_a_file_that_says_no_size_has_that_of_its_events(tmp_path: Path) -> None:
    path = written(tmp_path / "a.aedat3", packet((1, 7, 3, 1)))
    path.write_bytes(path.read_bytes().replace(b"DAVIS346", b"whatever"))
    stream = files.stream_of(path)
    assert (stream.width, stream.height, stream.sensor) == (8, 4, "unknown")


def test_others_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat3"
    for data, said in (
        (b"", "it has no #!AER-DAT3.1"),
        (b"#!AER-DAT3.1\r\n", "it has no #!END-HEADER"),
        (
            HEADER.replace(b"RAW", b"LZ4"),
            r"is compressed in a way that we do not know \(LZ4; known: RAW, Serial-TS,",
        ),
    ):
        path.write_bytes(data)
        with pytest.raises(EvsError, match=said):
            files.read(path)


def test_a_packet_may_have_none_one_or_very_many_events(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    for count in (0, 1, 65_535):
        t = np.sort(random.integers(0, 1000, count))
        columns = random.integers(0, 346, count), random.integers(0, 260, count)
        # AEDAT2 would be two files where its clock wraps
        for name, begin_us in (("a.aedat3", -500), ("a.csv", -500), ("a.aedat", 0)):
            given = t + (1 << 32) + begin_us
            events = make_events(given, *columns, random.integers(0, 2, count))
            sink = files.recorder_for(tmp_path / name)
            sink.open([StreamInfo(346, 260, tick_us=1 << 40)])
            sink.write(EventPacket(0, 0, 1 << 33, 346, 260, events))
            assert sink.close()["events"] == count
            assert files.read(tmp_path / name).tobytes() == events.tobytes()
