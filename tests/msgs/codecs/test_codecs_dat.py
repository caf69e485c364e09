"""DAT: rows by hand, wraps, and files of both versions."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from evs.drivers import files
from evs.drivers.files.integrity import BackwardsWarning
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events
from evs.msgs.codecs import DatState, decode_dat, encode_dat
from evs.msgs.header_fields import MessageError

WRAP = 1 << 32


def row(t: int, x: int, y: int, p: int) -> bytes:
    return struct.pack("<II", t, p << 28 | y << 14 | x)


def test_the_bytes_are_the_formats() -> None:
    events = make_events([1, WRAP - 1, WRAP + 7], [0, 16382, 5], [16382, 0, 6], [1, 0, 1])
    data = encode_dat(events)
    assert data == row(1, 0, 16382, 1) + row(WRAP - 1, 16382, 0, 0) + row(7, 5, 6, 1)
    for cut in range(0, 25, 8):
        first, state = decode_dat(data[:cut])
        second, end = decode_dat(data[cut:] + b"1234567", state)
        assert first.tolist() + second.tolist() == events.tolist()
        assert end == DatState(WRAP + 7)
    assert encode_dat(events[2:], after_us=WRAP - 1) == row(7, 5, 6, 1)
    assert encode_dat(events[:0]) == b""


def test_what_a_reader_would_not_see_is_refused() -> None:
    with pytest.raises(MessageError, match="needs an event every 4294967296 us"):
        encode_dat(make_events([1, WRAP + 1], [0, 0], [0, 0], [0, 0]))
    with pytest.raises(MessageError, match="comes after -1 us"):
        encode_dat(make_events([4], [0], [0], [0]), after_us=5)
    with pytest.raises(MessageError, match=r"DAT holds x of 0 \.\.\. 16382 px"):
        encode_dat(make_events([4], [16383], [0], [0]))


def test_a_small_fall_is_a_wrap_only_where_time_cannot_run_backwards() -> None:
    data = row(WRAP - 5, 1, 1, 1) + row(WRAP - 9, 1, 1, 1) + row(3, 1, 1, 1)
    assert decode_dat(data)[0]["t"].tolist() == [WRAP - 5, WRAP - 9, WRAP + 3]
    data = row(WRAP - 5, 1, 1, 1) + row(WRAP - 6, 1, 1, 1)
    assert decode_dat(data, ordered=True)[0]["t"].tolist() == [WRAP - 5, 2 * WRAP - 6]


def test_stamps_that_step_back_over_a_wrap_belong_before_it() -> None:
    stamps = [2, WRAP - 3, WRAP - 5, WRAP + 4, WRAP - 2, WRAP + 6, 2 * WRAP - 1, 2 * WRAP + 1]
    # nothing lies before the first wrap
    stamps.insert(1, WRAP - 1)
    # half of the range and less is a pause
    stamps.insert(-2, WRAP + 6 + WRAP // 2)
    data = b"".join(row(t % WRAP, 1, 1, 1) for t in stamps)
    for cut in range(0, len(data), 8):
        first, state = decode_dat(data[:cut])
        second, end = decode_dat(data[cut:], state)
        assert first["t"].tolist() + second["t"].tolist() == stamps
        assert end == DatState(2 * WRAP + 1)


def test_a_long_pause_across_the_wrap_comes_back_from_our_files(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    sink = files.recorder_for(path)
    sink.open([StreamInfo(9, 9, camera="eye")])
    events = make_events([3_000_000_000, 7_200_000_000], [1, 2], [3, 4], [1, 0])
    for event in (events[:1], events[1:]):
        sink.write(EventPacket(0, 0, 0, 9, 9, event))
    late = make_events([7_200_000_000 + WRAP], [1], [1], [1])
    with pytest.raises(EvsError, match=r"cannot record nothing for 4294967296 us .*\.aedat4"):
        sink.write(EventPacket(0, 0, 0, 9, 9, late))
    with pytest.raises(EvsError, match="no way back in time"):
        sink.write(EventPacket(0, 0, 0, 9, 9, events[:1]))
    assert sink.close()["events"] == 2
    assert files.read(path).tobytes() == events.tobytes()
    assert files.stream_of(path).camera == "eye"


def test_files_of_real_cameras(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    head = b"% Data file containing CD events.\n% Version 2\n% Date 2017-3-29 15:37:46\n"
    sides = b"% Height 240\n% Width 304\n"
    path.write_bytes(head + sides + b"\x0c\x08" + row(5, 303, 239, 1) + row(4, 0, 0, 0))
    with pytest.warns(BackwardsWarning):
        got = files.read(path)
    assert got.tolist() == [(4, 0, 0, 0), (5, 303, 239, 1)]
    assert (got.stream.width, got.stream.height) == (304, 240)
    # the oldest: 9 and 8 bits, no size
    old = struct.pack("<II", 5, 1 << 17 | 239 << 9 | 303)
    path.write_bytes(b"% Version 1\n\x00\x08" + old)
    got = files.read(path)
    assert got.tolist() == [(5, 303, 239, 1)]
    assert (got.stream.width, got.stream.height) == (304, 240)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "no header of lines"),
        (b"% Version 2\n", "no header of lines"),
        (b"% Version 3\n\x0c\x08", "is of DAT version '3'; 1 and 2 are read"),
        (b"% Version 2\n\x0e\x08", "no change events but trigger events of 8 bytes"),
        (b"% Version 2\n\x0c\x10", "no change events but change events of 16 bytes"),
        (b"% Version 2\n\x30\x08", "no change events but events of kind 48"),
    ],
)
def test_others_are_refused_in_one_line(tmp_path: Path, data: bytes, says: str) -> None:
    path = tmp_path / "a.dat"
    path.write_bytes(data)
    with pytest.raises(EvsError, match=says) as error:
        files.read(path)
    assert "\n" not in str(error.value)
