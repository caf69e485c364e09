"""EVT2.1: 64-bit words by hand, in both orders of their halves (streams: the round trips)."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.msgs import Events, make_events
from evs.msgs.codecs import decode_evt21, encode_evt21
from evs.msgs.header_fields import MessageError


def words(*numbers: int) -> bytes:
    return struct.pack(f"<{len(numbers)}Q", *numbers)


def high(number: int) -> int:
    return 8 << 60 | number << 32


def vector(on: int, low: int, x: int, y: int, valid: int) -> int:
    return on << 60 | low << 54 | x << 43 | y << 32 | valid


def rows(events: Events) -> list[tuple[int, ...]]:
    return [tuple(int(event[name]) for name in "txyp") for event in events]


SIX = make_events(
    [5, 5, 5, 5, 64, 64], [33, 63, 64, 40, 7, 7], [3, 3, 3, 3, 4, 4], [1, 1, 1, 1, 1, 0]
)
SAID = words(
    high(0),
    vector(1, 5, 32, 3, 1 << 1 | 1 << 31),
    vector(1, 5, 64, 3, 1),
    # back to the left: a word of its own, so that the order stays
    vector(1, 5, 32, 3, 1 << 8),
    high(1),
    vector(1, 0, 0, 4, 1 << 7),
    vector(0, 0, 0, 4, 1 << 7),
)


def test_events_of_one_instant_and_row_share_a_word() -> None:
    assert encode_evt21(SIX, time_origin_us=0) == SAID
    assert decode_evt21(SAID, time_origin_us=0)[0].tobytes() == SIX.tobytes()
    # an incomplete last word is ignored
    assert decode_evt21(SAID + b"\0" * 7, time_origin_us=0)[0].tobytes() == SIX.tobytes()
    second = encode_evt21(SIX[4:], time_origin_us=0, after_us=5)
    assert second == words(high(0)) + SAID[32:]


def test_other_words_and_pixels_too_far_right() -> None:
    said = words(
        vector(1, 5, 32, 3, 0b11),
        high(2),
        10 << 60 | 1,
        14 << 60 | 0xFFFFFFFF,
        # not on a multiple of 32
        vector(1, 1, 2047, 3, 0b11),
        vector(0, 1, 5, 3, 0),
    )
    events, state = decode_evt21(said, time_origin_us=0)
    assert rows(events) == [(129, 2047, 3, 1)]
    # two without a time, one beyond x = 2047
    assert state.skipped == 3


def test_each_wrap_is_told() -> None:
    events = make_events([10, 2**34 + 2**33], [0, 0], [0, 0], [0, 0])
    data = encode_evt21(events, time_origin_us=0)
    told = [number >> 32 & 0xFFFFFFF for number in struct.unpack(f"<{len(data) // 8}Q", data)]
    assert [told[0], *told[2:-1]] == [0, 2**27, 2**28 - 1, 0, 2**27, 2**27]
    assert rows(decode_evt21(data, time_origin_us=0)[0]) == rows(events)
    with pytest.raises(MessageError, match=r"do not follow"):
        encode_evt21(events, after_us=11)


@pytest.mark.parametrize("said", [";endianness=legacy", ";endianness=little", ""])
@pytest.mark.parametrize("swapped", [False, True])
def test_an_imx636_sends_the_upper_half_first(tmp_path: Path, said: str, swapped: bool) -> None:
    data = SAID
    if swapped:
        data = np.frombuffer(data, "<u4").reshape(-1, 2)[:, ::-1].tobytes()
    path = tmp_path / "a.raw"
    path.write_bytes(f"% format EVT21;height=48;width=96{said}\n% end\n".encode() + data)
    told_right = {";endianness=legacy": swapped, ";endianness=little": not swapped}
    if told_right.get(said, True):
        assert rows(files.read(path)) == rows(SIX)
    assert files.summary(path).format == "evt21"
