"""Encodings against plain decoders of one word at a time, and there and back."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.msgs import Events, join_events, make_events
from evs.msgs.codecs import (
    PAYLOADS,
    Evt2State,
    Evt3State,
    Evt21State,
    PayloadReader,
    PayloadWriter,
    decode_evt2,
    decode_evt3,
    decode_evt21,
    encode_evt2,
    encode_evt3,
    encode_evt21,
)

pytestmark = pytest.mark.property

Rows = list[tuple[int, int, int, int]]


def plain_evt3(words: Iterable[int]) -> tuple[Rows, int]:
    """Events and how many were left out, from the format's description, a word at a time."""
    found: Rows = []
    high = y = -1
    low = base = on = skipped = 0
    for word in words:
        kind, value = word >> 12, word & 0xFFF
        pixels: list[tuple[int, int]] = []
        if kind == 0:
            y = value & 0x7FF
        elif kind == 2:
            pixels = [(value & 0x7FF, value >> 11)]
        elif kind == 3:
            base, on = value & 0x7FF, value >> 11
        elif kind in (4, 5):
            many = 12 if kind == 4 else 8
            pixels = [(base + k, on) for k in range(many) if value >> k & 1]
            base += many
        elif kind == 6:
            low = value
        elif kind == 8:
            wraps = 0 if high < 0 else (high >> 12) + ((high & 0xFFF) - value > 2047)
            new = wraps << 12 | value
            high, low = new, low if new == high else 0
        for x, p in pixels:
            if high < 0 or y < 0 or x > 2047:
                skipped += 1
            else:
                found.append((high << 12 | low, x, y, p))
    return found, skipped


def plain_evt2(words: Iterable[int]) -> tuple[Rows, int]:
    """The same for EVT2."""
    found: Rows = []
    high, skipped = -1, 0
    for word in words:
        kind, value = word >> 28, word & 0xFFFFFFF
        if kind == 8:
            wraps = 0 if high < 0 else (high >> 28) + ((high & 0xFFFFFFF) - value > (1 << 27) - 1)
            high = wraps << 28 | value
        elif kind < 2 and high < 0:
            skipped += 1
        elif kind < 2:
            found.append((high << 6 | value >> 22, value >> 11 & 0x7FF, value & 0x7FF, kind))
    return found, skipped


def plain_evt21(words: Iterable[int]) -> tuple[Rows, int]:
    """The same for EVT2.1."""
    found: Rows = []
    high, skipped = -1, 0
    for word in words:
        kind, value = word >> 60, word >> 32 & 0xFFFFFFF
        if kind == 8:
            wraps = 0 if high < 0 else (high >> 28) + ((high & 0xFFFFFFF) - value > (1 << 27) - 1)
            high = wraps << 28 | value
        elif kind < 2:
            for pixel in range(32):
                x = (value >> 11 & 0x7FF) + pixel
                if word >> pixel & 1 and (high < 0 or x > 2047):
                    skipped += 1
                elif word >> pixel & 1:
                    found.append((high << 6 | value >> 22, x, value & 0x7FF, kind))
    return found, skipped


def plain_libcaer_cmp(words: Iterable[int], base_us: int) -> Rows:
    """The events of one packet of libcaer_cmp, from the format's description, a word at a time."""
    found: Rows = []
    high = low = x = base = on = 0
    for word in words:
        kind, value = word >> 12, word & 0xFFF
        if kind == 0:
            high = value
        elif kind == 1:
            low = value
        elif kind == 2:
            x = value & 0x7FF
        elif kind == 3:
            found.append((base_us + (high << 12 | low), x, value & 0x7FF, value >> 11))
        elif kind == 4:
            base, on = value & 0x7FF, value >> 11
        elif kind == 5:
            for k in range(8):
                if value >> k & 1:
                    found.append((base_us + (high << 12 | low), x, base + k, on))
            base += 8
    return found


def rows(events: Events) -> Rows:
    return list(zip(*(events[name].tolist() for name in "txyp"), strict=True))


def pieces(data: bytes, cuts: list[int], size: int) -> list[bytes]:
    places = sorted({0, len(data), *(cut * size % (len(data) + size) for cut in cuts)})
    return [data[a:b] for a, b in itertools.pairwise(places)]


halves = st.lists(
    st.one_of(
        st.integers(0, 0xFFFF),
        # mostly words that mean something
        st.builds(
            lambda k, v: k << 12 | v,
            st.sampled_from([0, 2, 3, 4, 5, 6, 8, 8]),
            st.one_of(st.integers(0, 0xFFF), st.sampled_from([0, 1, 0x7FF, 0x800, 0xFFF])),
        ),
    ),
    max_size=60,
)
wholes = st.lists(
    st.builds(
        lambda k, v: k << 28 | v,
        st.sampled_from([0, 1, 8, 8, 10, 14]),
        st.one_of(st.integers(0, 2**28 - 1), st.sampled_from([0, 1, 2**27, 2**28 - 1])),
    ),
    max_size=40,
)


longs = st.lists(
    st.tuples(wholes, st.integers(0, 2**32 - 1) | st.sampled_from([0, 1, 2**31])).map(
        lambda pair: [word << 32 | pair[1] for word in pair[0]]
    ),
    max_size=12,
).map(lambda lists: [word for one in lists for word in one][:60])


@given(words=longs, cuts=st.lists(st.integers(0, 1000), max_size=4), swapped=st.booleans())
def test_any_evt21_words_mean_what_a_plain_decoder_says(
    words: list[int], cuts: list[int], swapped: bool
) -> None:
    data = np.array(words, "<u8").tobytes()
    if swapped:
        data = np.frombuffer(data, "<u4").reshape(-1, 2)[:, ::-1].tobytes()
    state, found = Evt21State(), []
    for piece in pieces(data, cuts, 8):
        events, state = decode_evt21(piece, state, time_origin_us=0, upper_first=swapped)
        found.append(events)
    expected, skipped = plain_evt21(words)
    assert rows(join_events(found)) == expected
    assert state.skipped == skipped


@given(words=halves, cuts=st.lists(st.integers(0, 1000), max_size=4))
def test_any_evt3_words_mean_what_a_plain_decoder_says(words: list[int], cuts: list[int]) -> None:
    data = np.array(words, "<u2").tobytes()
    state, found = Evt3State(), []
    for piece in pieces(data, cuts, 2):
        events, state = decode_evt3(piece, state, time_origin_us=0)
        found.append(events)
    expected, skipped = plain_evt3(words)
    assert rows(join_events(found)) == expected
    assert state.skipped == skipped


@given(words=wholes, cuts=st.lists(st.integers(0, 1000), max_size=4))
def test_any_evt2_words_mean_what_a_plain_decoder_says(words: list[int], cuts: list[int]) -> None:
    data = np.array(words, "<u4").tobytes()
    state, found = Evt2State(), []
    for piece in pieces(data, cuts, 4):
        events, state = decode_evt2(piece, state, time_origin_us=0)
        found.append(events)
    expected, skipped = plain_evt2(words)
    assert rows(join_events(found)) == expected
    assert state.skipped == skipped


@st.composite
def streams(draw: st.DrawFn) -> list[Events]:
    """Packets of one camera: gaps of any length between events, and any number in a packet."""
    gaps = st.one_of(st.integers(0, 3), st.integers(0, 5000), st.integers(0, 2**26))
    side = st.sampled_from([0, 1, 2046, 2047])
    row = st.tuples(gaps, side, side, st.integers(0, 1))
    start = draw(st.sampled_from([0, 1, 2**24 - 9, 2**31 - 9, 2**32 - 9, 2**34 - 1_000_009]))
    made = []
    for packet in draw(st.lists(st.lists(row, max_size=12), max_size=5)):
        columns = np.array(packet, np.int64).reshape(-1, 4)
        stamps = start + np.cumsum(columns[:, 0])
        start = int(stamps[-1]) if len(stamps) else start
        made.append(make_events(stamps, *columns[:, 1:].T))
    return made


@given(packets=streams())
def test_streams_come_back_and_plain_decoders_agree(packets: list[Events]) -> None:
    whole = join_events(packets)
    for encode, decode, plain, size in (
        (encode_evt3, decode_evt3, plain_evt3, "<u2"),
        (encode_evt2, decode_evt2, plain_evt2, "<u4"),
        (encode_evt21, decode_evt21, plain_evt21, "<u8"),
    ):
        after_us, data = -1_000_000, b""
        for packet in packets:
            data += encode(packet, after_us=after_us)  # type: ignore[operator]
            after_us = int(packet["t"][-1]) if len(packet) else after_us
        events, state = decode(data)  # type: ignore[operator]
        assert events.tobytes() == whole.tobytes()
        assert state.skipped == 0
        absolute, _ = plain(np.frombuffer(data, size).tolist())
        assert [t - 1_000_000 for t, _, _, _ in absolute] == whole["t"].tolist()


@given(packets=streams())
def test_payloads_come_back(packets: list[Events]) -> None:
    for name in PAYLOADS:
        writer, reader = PayloadWriter(name), PayloadReader(name)
        for packet in packets:
            # mono counts 4.29 s from a packet's first event, libcaer_cmp 16.8 s
            short = packet[packet["t"] - packet["t"][:1] < 4_294_967] if len(packet) else packet
            time_base_ns, data = writer.payload(short)
            assert rows(reader.events(data, time_base_ns)) == rows(short)


@st.composite
def columns(draw: st.DrawFn) -> list[Events]:
    """Parts of one message of libcaer_cmp: rows that rise, repeat, fall and cross 8 aligned ones.

    Gaps pass the 12 lower bits of the time, and end just within its 24 bits.
    """
    gaps = st.sampled_from([0, 0, 0, 0, 0, 1, 4095, 4096, 8192])
    x, y = st.sampled_from([0, 0, 0, 2047]), st.one_of(st.integers(0, 17), st.just(2047))
    row = st.tuples(gaps, x, y, st.sampled_from([0, 0, 1]))
    start = draw(st.sampled_from([0, 1, 2**31 - 9, 1_702_669_729_854_452]))
    packets = draw(st.lists(st.lists(row, max_size=30), min_size=1, max_size=4))
    counted = np.array([one for packet in packets for one in packet], np.int64).reshape(-1, 4)
    events = make_events(start + np.cumsum(counted[:, 0]), *counted[:, 1:].T)
    if len(events) and draw(st.booleans()):
        events["t"][-1] = events["t"][0] + 2**24 - 1
    return np.split(events, np.cumsum([len(packet) for packet in packets])[:-1])


@given(parts=columns())
def test_messages_of_libcaer_cmp_come_back_and_a_plain_decoder_agrees(parts: list[Events]) -> None:
    writer, data, base_us = PayloadWriter("libcaer_cmp"), b"", None
    for part in parts:
        _, words = writer.payload(part, base_us)
        if len(part) and base_us is None:
            base_us = int(part["t"][0])
        data += words
    whole = join_events(parts)
    base_us = base_us or 0
    assert rows(PayloadReader("libcaer_cmp").events(data, 1000 * base_us)) == rows(whole)
    words_given = np.frombuffer(data, "<u2").tolist()
    assert plain_libcaer_cmp(words_given, base_us) == rows(whole)
    assert len(words_given) <= 5 * len(whole)


@given(data=st.binary(max_size=300), time_base_ns=st.integers(0, 2**64 - 1))
def test_any_bytes_are_some_events(data: bytes, time_base_ns: int) -> None:
    for name in PAYLOADS:
        events = PayloadReader(name).events(data, time_base_ns)
        # a word of 2 bytes is 12 events at most
        assert len(events) <= 6 * len(data)
        assert int(events["x"].min(initial=0)) >= 0
        assert int(events["y"].min(initial=0)) >= 0
        assert set(events["p"].tolist()) <= {0, 1}
        assert events.view("u1").reshape(-1, 16)[:, 13:].max(initial=0) == 0
