"""EVT2 and EVT2.1, Prophesee's formats of 32-bit and of 64-bit words, little-endian.

A word of EVT2 has its type in bits 31-28, then its value:

    0 CD_OFF, 1 CD_ON  bits 27-22 lower bits of the time, us; 21-11 x; 10-0 y: one event
    8 TIME_HIGH        bits 27-0: bits 33-6 of the time; wraps every 4.8 h
    10 EXT_TRIGGER     bits 27-22 lower bits of the time; 12-8 input; bit 0: the edge rises

The upper half of a word of EVT2.1 has the same layout; x of an event is a multiple of 32, and the
lower half states which of the 32 pixels from x on have an event. Cameras with an IMX636 send the
upper half first ("legacy"). Other words (counters) are not about events and are skipped. Source:
Prophesee's description of the formats.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.codecs.counter_wraps import (
    counter_words_between,
    encode_in_blocks,
    insert_counter_words,
    unwrap_counter,
)
from evs.msgs.codecs.limits import (
    LONGEST_US,
    MAX_SIDE_EVT_PX,
    TIME_ORIGIN_US,
    EncodingLimits,
    check_fits,
    decoder_time_us,
)
from evs.msgs.event import Events, empty_events
from evs.msgs.trigger import Triggers, external_triggers

EVT2 = EncodingLimits("EVT2", MAX_SIDE_EVT_PX, MAX_SIDE_EVT_PX, LONGEST_US)

_ON, _HIGH, _TRIGGER = 1, 8, 10
_LOW_BITS, _BITS = 6, 28
_MASK = (1 << _BITS) - 1

Words = npt.NDArray[np.uint32]


def encode_evt2(
    events: Events, *, time_origin_us: int = TIME_ORIGIN_US, after_us: int | None = None
) -> bytes:
    """Encode a packet as EVT2 words; it begins with the upper bits of the time.

    Args:
        events: (n,) EVENT_DTYPE, sorted by t.
        time_origin_us: Time stamp of the stream's time zero, us.
        after_us: Time of the stream's last packet, us, so that wraps of the counter since then are
            encoded; -time_origin_us for the first packet of a file, which then encodes the time
            from zero; None: the decoder counts from here.

    Returns:
        The bytes; empty for no events.

    Raises:
        MessageError: x or y is over 2047, a time stamp is negative, or time steps back.
    """
    return encode_in_blocks(events, EVT2, time_origin_us, after_us, _high_word, _block)


def _block(events: Events, stamps: npt.NDArray[np.int64], known_us: int) -> Words:
    """The words of some events, after those that bring a decoder from `known_us` here."""
    high = stamps >> _LOW_BITS
    words = np.empty((len(events), 2), "<u4")
    words[:, 0] = (high & _MASK) | _HIGH << _BITS
    low = (stamps & ((1 << _LOW_BITS) - 1)).astype(np.uint32)
    place = events["x"].astype(np.uint32) << 11 | events["y"].astype(np.uint32)
    words[:, 1] = (events["p"] != 0).astype(np.uint32) << _BITS | low << 22 | place
    is_sent = np.ones((len(events), 2), bool)
    np.not_equal(high[1:], high[:-1], out=is_sent[1:, 0])
    known = known_us >> _LOW_BITS
    return insert_counter_words(words, is_sent, high, known, _BITS, _high_words)


def _high_word(t_us: int) -> Words:
    return _high_words(np.array([t_us >> _LOW_BITS]))


def _high_words(high: npt.NDArray[np.int64]) -> Words:
    return ((high & _MASK) | _HIGH << _BITS).astype("<u4")


@dataclass(frozen=True)
class Evt2State:
    """The state of a decoder between two pieces of a stream."""

    high: int = -1
    """upper bits of the time, wraps counted; -1: not known yet"""
    skipped: int = 0
    """events so far that came before the first time stamp"""


def decode_evt2(
    data: Any,
    state: Evt2State | None = None,
    *,
    time_origin_us: int = TIME_ORIGIN_US,
    triggers: list[Triggers] | None = None,
) -> tuple[Events, Evt2State]:
    """Decode a piece of an EVT2 stream.

    Args:
        data: Any contiguous buffer of whole words; up to 3 last bytes are ignored.
        state: The state after the piece before; None: the stream starts here.
        time_origin_us: Time stamp of the stream's time zero, us.
        triggers: A list that takes the array of external triggers in the piece, (m,); those before
            the first time stamp are left out.

    Returns:
        (n,) events in the order of the words, which may be unsorted, and the next state.
    """
    state = state or Evt2State()
    words = np.frombuffer(data, "<u4", memoryview(data).nbytes // 4)
    kinds = (words >> _BITS).astype(np.uint8)
    is_event = kinds <= _ON
    highs, places = _times_high(words, kinds, state.high)
    if triggers is not None:
        _append_triggers(triggers, words, kinds, highs, places, time_origin_us)
    selected, high = words[is_event], highs[places[is_event]]
    events = empty_events(len(selected))
    events["t"] = (high << _LOW_BITS | (selected >> 22 & 0x3F)) - time_origin_us
    events["x"] = selected >> 11 & 0x7FF
    events["y"] = selected & 0x7FF
    events["p"] = selected >> _BITS
    without_time = int(np.count_nonzero(high < 0))
    return events[without_time:], Evt2State(int(highs[-1]), state.skipped + without_time)


def _times_high(
    words: Words, kinds: npt.NDArray[np.uint8], known: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
    """The upper bits of the time at each word, with their wraps counted.

    Args:
        words: (n,) words of EVT2, or the upper halves of those of EVT2.1.
        kinds: (n,) their types.
        known: The upper bits before the first word; -1 for none.

    Returns:
        (m + 1,) `known`, then the upper bits of each TIME_HIGH; (n,) the place of each word's
        among them.
    """
    is_high = kinds == _HIGH
    highs = np.concatenate([[known], unwrap_counter(words[is_high] & _MASK, known, _BITS)])
    return highs.astype(np.int64), np.cumsum(is_high, dtype=np.int32)


def _append_triggers(
    triggers: list[Triggers],
    words: Words,
    kinds: npt.NDArray[np.uint8],
    highs: npt.NDArray[np.int64],
    places: npt.NDArray[np.int32],
    time_origin_us: int,
) -> None:
    """Append the external triggers, if there are any, that follow a TIME_HIGH.

    Args:
        triggers: Takes an array of triggers, as unsorted as they were.
        words: (n,) words of EVT2, or the upper halves of those of EVT2.1.
        kinds: (n,) their types.
        highs: (m + 1,) as `_times_high` returns them.
        places: (n,) as `_times_high` returns them.
        time_origin_us: Time stamp of the stream's time zero, us.
    """
    is_trigger = kinds == _TRIGGER
    if is_trigger.any():
        edges, high = words[is_trigger], highs[places[is_trigger]]
        edges, high = edges[high >= 0], high[high >= 0]
        t = (high << _LOW_BITS | (edges >> 22 & 0x3F)) - time_origin_us
        triggers.append(external_triggers(t, edges & 1))


EVT21 = EncodingLimits("EVT2.1", MAX_SIDE_EVT_PX, MAX_SIDE_EVT_PX, LONGEST_US)

_TYPE_AT, _LOW_AT, _X_AT, _Y_AT = 60, 54, 43, 32
"""where the parts of a word of EVT2.1 begin"""

_VECTOR = 32
"""pixels of a word"""

VectorWords = npt.NDArray[np.uint64]


def encode_evt21(
    events: Events, *, time_origin_us: int = TIME_ORIGIN_US, after_us: int | None = None
) -> bytes:
    """Encode a packet as EVT2.1 words; it begins with the upper bits of the time.

    Events of one stamp, row, polarity and block of 32 pixels that follow one another with rising x
    become one word, so that decoding keeps their order.

    Args:
        events: (n,) EVENT_DTYPE, sorted by t.
        time_origin_us: Time stamp of the stream's time zero, us.
        after_us: Time of the stream's last packet, us, so that wraps of the counter since then are
            encoded; -time_origin_us for the first packet of a file, which then encodes the time
            from zero; None: the decoder counts from here.

    Returns:
        The bytes; empty for no events.

    Raises:
        MessageError: x or y is over 2047, a time stamp is negative, or time steps back.
    """
    check_fits(events, EVT21, time_origin_us)
    if not len(events):
        return b""
    stamps = events["t"] + time_origin_us
    known = decoder_time_us(events, time_origin_us, after_us)
    x, y = events["x"].astype(np.int64), events["y"].astype(np.int64)
    on = (events["p"] != 0).astype(np.int64)
    high = stamps >> _LOW_BITS
    # what is the same for all events of a word
    base = on << _TYPE_AT | (stamps & 63) << _LOW_AT | (x & -_VECTOR) << _X_AT | y << _Y_AT
    new = np.ones(len(events), bool)
    new[1:] = (base[1:] != base[:-1]) | (high[1:] != high[:-1]) | (x[1:] <= x[:-1])
    begins = np.flatnonzero(new)
    bits = np.left_shift(np.int64(1), x & _VECTOR - 1)
    vectors = (base[begins] | np.bitwise_or.reduceat(bits, begins)).astype(np.uint64)
    # the upper bits where they change, each wrap of them at length
    high = high[begins]
    before = np.concatenate([[known >> _LOW_BITS], high[:-1]])
    counts, extra = counter_words_between(before, high, _BITS)
    changes = np.flatnonzero(np.concatenate([[True], high[1:] != high[:-1]]))
    places = np.concatenate([np.repeat(np.arange(len(high)), counts), changes])
    order = np.argsort(places, kind="stable")
    time_words = _high_vector_words(np.concatenate([extra, high[changes]]))[order]
    words = np.insert(vectors, places[order], time_words)
    if after_us is not None:
        words = np.concatenate([_high_vector_words(np.array([known >> _LOW_BITS])), words])
    return words.astype("<u8").tobytes()


def _high_vector_words(high: npt.NDArray[np.int64]) -> VectorWords:
    words: VectorWords = ((high & _MASK) << 32).astype(np.uint64) | np.uint64(_HIGH << _TYPE_AT)
    return words


@dataclass(frozen=True)
class Evt21State(Evt2State):
    """The state of a decoder between two pieces of a stream, like that of EVT2."""


def decode_evt21(
    data: Any,
    state: Evt21State | None = None,
    *,
    time_origin_us: int = TIME_ORIGIN_US,
    upper_first: bool = False,
    triggers: list[Triggers] | None = None,
) -> tuple[Events, Evt21State]:
    """Decode a piece of an EVT2.1 stream. Events of a vector beyond x = 2047 are skipped.

    Args:
        data: Any contiguous buffer of whole words; up to 7 last bytes are ignored.
        state: The state after the piece before; None: the stream starts here.
        time_origin_us: Time stamp of the stream's time zero, us.
        upper_first: Whether each word's upper half comes first, as an IMX636 sends it.
        triggers: A list that takes the array of external triggers in the piece, (m,); those before
            the first time stamp are left out.

    Returns:
        (n,) events in the order of the words, which may be unsorted, and the next state.
    """
    state = state or Evt21State()
    halves = np.frombuffer(data, "<u4", memoryview(data).nbytes // 8 * 2).reshape(-1, 2)
    upper, valid = halves[:, 1 - upper_first], halves[:, int(upper_first)]
    kinds = (upper >> _BITS).astype(np.uint8)
    is_vector = kinds <= _ON
    highs, places = _times_high(upper, kinds, state.high)
    if triggers is not None:
        _append_triggers(triggers, upper, kinds, highs, places, time_origin_us)
    selected, high = upper[is_vector], highs[places[is_vector]]
    # one bit a pixel, word after word
    bits = np.unpackbits(valid[is_vector].astype("<u4").view(np.uint8), bitorder="little")
    pixels = np.flatnonzero(bits.view(np.bool_))
    word = pixels >> 5
    selected, high = selected[word], high[word]
    x = (selected >> 11 & 0x7FF) + (pixels & _VECTOR - 1).astype(np.uint32)
    is_valid = (high >= 0) & (x < MAX_SIDE_EVT_PX)
    selected, high = selected[is_valid], high[is_valid]
    events = empty_events(len(selected))
    events["t"] = (high << _LOW_BITS | (selected >> 22 & 0x3F)) - time_origin_us
    events["x"] = x[is_valid]
    events["y"] = selected & 0x7FF
    events["p"] = selected >> _BITS
    skipped = state.skipped + len(is_valid) - len(selected)
    return events, Evt21State(int(highs[-1]), skipped)
