"""EVT2.1, Prophesee's format of 64-bit words, little-endian: type in bits 63-60, then its value.

    0 EVT_NEG, 1 EVT_POS  bits 59-54 lower bits of the time, us; 53-43 x, a multiple of 32; 42-32 y;
                          31-0 which of the 32 pixels from x on have an event
    8 TIME_HIGH           bits 59-32: bits 33-6 of the time; wraps every 4.8 h
    10 EXT_TRIGGER        bits 59-54 lower bits of the time; 44-40 input; bit 32: the edge rises
Others (counters) are not about events and are skipped. Cameras with an IMX636 send
the upper half of each word first ("legacy"). Source: Prophesee's description of the format.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.codecs.counter_wraps import counter_words_between
from evs.msgs.codecs.evt2 import Evt2State, append_triggers, times_high
from evs.msgs.codecs.limits import (
    LONGEST_US,
    MAX_SIDE_EVT_PX,
    TIME_ORIGIN_US,
    EncodingLimits,
    check_fits,
    decoder_time_us,
)
from evs.msgs.event import Events, empty_events
from evs.msgs.trigger import Triggers

EVT21 = EncodingLimits("EVT2.1", MAX_SIDE_EVT_PX, MAX_SIDE_EVT_PX, LONGEST_US)

_ON, _HIGH = 1, 8
_LOW_BITS, _BITS = 6, 28
_MASK = (1 << _BITS) - 1
_TYPE, _LOW, _X, _Y = 60, 54, 43, 32
_VECTOR = 32
"""Pixels that one word speaks of."""

Words = npt.NDArray[np.uint64]


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
    base = on << _TYPE | (stamps & 63) << _LOW | (x & -_VECTOR) << _X | y << _Y
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
    time_words = _high_words(np.concatenate([extra, high[changes]]))[order]
    words = np.insert(vectors, places[order], time_words)
    if after_us is not None:
        words = np.concatenate([_high_words(np.array([known >> _LOW_BITS])), words])
    return words.astype("<u8").tobytes()


def _high_words(high: npt.NDArray[Any]) -> Words:
    words: Words = ((high & _MASK) << 32).astype(np.uint64) | np.uint64(_HIGH << _TYPE)
    return words


@dataclass(frozen=True)
class Evt21State(Evt2State):
    """What a decoder knows between two pieces of a stream: as EVT2's."""


def decode_evt21(
    data: Any,
    state: Evt21State | None = None,
    *,
    time_origin_us: int = TIME_ORIGIN_US,
    upper_first: bool = False,
    triggers: list[Triggers] | None = None,
) -> tuple[Events, Evt21State]:
    """Decode a piece of an EVT2.1 stream. Events of a vector beyond x = 2047 are left out.

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
    highs, places = times_high(upper, kinds, state.high)
    if triggers is not None:
        append_triggers(triggers, upper, kinds, highs, places, time_origin_us)
    taken, high = upper[is_vector], highs[places[is_vector]]
    # one bit a pixel, word after word
    bits = np.unpackbits(valid[is_vector].astype("<u4").view(np.uint8), bitorder="little")
    pixels = np.flatnonzero(bits.view(np.bool_))
    word = pixels >> 5
    taken, high = taken[word], high[word]
    x = (taken >> 11 & 0x7FF) + (pixels & _VECTOR - 1).astype(np.uint32)
    is_valid = (high >= 0) & (x < MAX_SIDE_EVT_PX)
    taken, high = taken[is_valid], high[is_valid]
    events = empty_events(len(taken))
    events["t"] = (high << _LOW_BITS | (taken >> 22 & 0x3F)) - time_origin_us
    events["x"] = x[is_valid]
    events["y"] = taken & 0x7FF
    events["p"] = taken >> _BITS
    skipped = state.skipped + len(is_valid) - len(taken)
    return events, Evt21State(int(highs[-1]), skipped)
