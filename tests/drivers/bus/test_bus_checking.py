"""The native check of events says yes exactly where the one in words has nothing to say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.bus.sockets import quick_check
from evs.msgs import EVENT_DTYPE, EventPacket, MessageError, decode, empty_events, encode
from evs.msgs.packet import check_events

pytestmark = pytest.mark.property

SIZE = {"width": 346, "height": 260}
INTERVAL = {"time_base": 1000, "time_end": 2000}
EDGES = [-(2**63), -1, 0, 1, 999, 1000, 1001, 2000, 2001, 2**63 - 1]


def holds(events: np.ndarray[Any, Any]) -> bool:
    try:
        check_events(events, {**INTERVAL, **SIZE})
    except MessageError:
        return False
    return True


def asked(raw: bytes | memoryview) -> bool:
    return quick_check()(raw, *INTERVAL.values(), *SIZE.values())


def sound(count: int, seed: int) -> np.ndarray[Any, Any]:
    random, events = np.random.default_rng(seed), empty_events(count)
    events["t"] = np.sort(random.integers(1001, 2001, count))
    events["x"], events["y"] = random.integers(0, 346, count), random.integers(0, 260, count)
    events["p"] = random.integers(0, 2, count)
    return events


@given(st.integers(0, 400), st.integers(0, 2**32))
def test_sound_events_pass(count: int, seed: int) -> None:
    events = sound(count, seed)
    assert asked(events.tobytes())
    assert holds(events)


@given(
    st.integers(1, 200),
    st.integers(0, 2**32),
    st.sampled_from(["t", "x", "y", "p"]),
    st.sampled_from(EDGES) | st.integers(-(2**15), 2**15),
    st.data(),
)
def test_one_odd_value_is_judged_alike(
    count: int, seed: int, field: str, value: int, data: st.DataObject
) -> None:
    events, place = sound(count, seed), data.draw(st.integers(0, count - 1))
    bits = 8 * EVENT_DTYPE[field].itemsize
    events[field][place] = (value + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)
    assert asked(events.tobytes()) == holds(events)


@given(st.integers(1, 20), st.integers(0, 2**32), st.data())
def test_one_odd_byte_is_judged_alike(count: int, seed: int, data: st.DataObject) -> None:
    raw = bytearray(sound(count, seed).tobytes())
    raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    assert asked(memoryview(raw)) == holds(np.frombuffer(raw, EVENT_DTYPE))


@pytest.mark.parametrize("base_us", [-(2**63) + 1, 2**63 - 1])
def test_intervals_at_the_ends_of_time(base_us: int) -> None:
    events = sound(1, 0)
    events["t"] = base_us
    check = quick_check()
    assert not check(events.tobytes(), base_us, base_us, 346, 260)
    assert check(events.tobytes(), base_us - 1, base_us, 346, 260)
    assert check(b"", base_us, base_us, 346, 260)


def test_what_is_not_whole_events_or_no_bytes_at_all() -> None:
    check = quick_check()
    assert not check(bytes(15), -1, 1, 346, 260)
    with pytest.raises(TypeError):
        check(17, -1, 1, 346, 260)  # type: ignore[arg-type]


def test_events_anywhere_in_memory() -> None:
    raw = b"0" + sound(9, 3).tobytes()
    assert asked(memoryview(raw)[1:])


def test_the_codec_refuses_and_cleans_the_same_with_it_and_without() -> None:
    events = sound(5, 1)
    packet = EventPacket(0, 1000, 2000, 346, 260, events)
    header, raw = encode(packet, quick_check())
    assert (header, bytes(raw)) == (encode(packet)[0], bytes(encode(packet)[1]))
    dirty = np.frombuffer(bytearray(events.tobytes()), np.uint8)
    dirty[13::16] = 7
    unclean = EventPacket(0, 1000, 2000, 346, 260, dirty.view(EVENT_DTYPE))
    assert bytes(encode(unclean, quick_check())[1]) == bytes(raw)
    for quick in (None, quick_check()):
        with pytest.raises(MessageError, match="padding is not zero"):
            decode(header, dirty.tobytes(), quick)
        assert decode(header, bytes(raw), quick).events.tobytes() == events.tobytes()
