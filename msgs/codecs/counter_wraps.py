"""Counters that wrap: how EVT2 and EVT3 encode the upper bits of time, and how to decode them.

A TIME_HIGH word holds a limited number of upper bits of the time; a decoder counts how often they
have wrapped. Decoders differ in what they treat as a wrap: some require a fall from nearly the
largest number to nearly zero, others any fall by more than ten, and some treat a rise from nearly
zero to nearly the largest number as a step back. All of them understand an encoder that sends half
of the range each time it is passed, and the largest number and zero at each wrap. The encoders of
EVT2 and EVT3 differ only in their words.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.codecs.limits import EncodingLimits, check_fits, decoder_time_us
from evs.msgs.event import Events

Integers = npt.NDArray[np.int64]

_BLOCK = 1 << 14
"""events encoded at once: their columns stay in the cache"""


def encode_in_blocks(
    events: Events,
    limits: EncodingLimits,
    time_origin_us: int,
    after_us: int | None,
    high_word: Callable[[int], npt.NDArray[Any]],
    encode: Callable[[Events, Integers, int], npt.NDArray[Any]],
) -> bytes:
    """Encode a packet block by block, after the upper bits of the time.

    Args:
        events: (n,) EVENT_DTYPE, sorted by t.
        limits: What the encoding can hold.
        time_origin_us: Time stamp of the stream's time zero, us.
        after_us: Time of the stream's last packet, us; None: the decoder counts from here.
        high_word: The word with the upper bits of a time, us.
        encode: The words of a block, of its events, their time stamps, us, and the time stamp that
            the decoder has reached, us.

    Returns:
        The bytes; empty for no events.

    Raises:
        MessageError: The events do not fit into the encoding.
    """
    check_fits(events, limits, time_origin_us)
    if not len(events):
        return b""
    known_us = decoder_time_us(events, time_origin_us, after_us)
    parts = [] if after_us is None else [high_word(known_us)]
    for start in range(0, len(events), _BLOCK):
        block = events[start : start + _BLOCK]
        parts.append(encode(block, block["t"] + time_origin_us, known_us))
        known_us = int(block["t"][-1]) + time_origin_us
    return np.concatenate(parts).tobytes()


def insert_counter_words(
    words: npt.NDArray[Any],
    is_sent: npt.NDArray[np.bool_],
    high: Integers,
    known: int,
    bits: int,
    high_words: Callable[[Integers], npt.NDArray[Any]],
) -> npt.NDArray[Any]:
    """Choose the words of a block that are sent, and insert those that let a decoder count.

    Args:
        words: (n, k) the possible words of n events.
        is_sent: (n, k) which of them have new content.
        high: (n,) upper bits of time, without wraps.
        known: The upper bits that the decoder has reached.
        bits: Bits of the counter.
        high_words: Counter values, (m,), as words.

    Returns:
        (m,) the words in their order.
    """
    chosen = words[is_sent]
    before = np.concatenate([[known], high[:-1]])
    if before[0] >> bits - 1 == high[-1] >> bits - 1:
        return chosen
    # send extra words where the counter passes half of its range or wraps
    counts, extra = counter_words_between(before, high, bits)
    sent = np.count_nonzero(is_sent, 1)
    starts = np.cumsum(sent) - sent
    return np.insert(chosen, np.repeat(starts, counts), high_words(extra))


def counter_words_between(
    before: Integers, after: Integers, bits: int
) -> tuple[Integers, Integers]:
    """The extra counter values that let a decoder count from `before` to `after`.

    Args:
        before: (n,) int64 upper bits of time, without wraps.
        after: (n,) int64 the same, not below `before`.
        bits: Bits of the counter.

    Returns:
        (n,) how many values each place needs, and the values (their sum,): half, largest, zero, ...
    """
    # whole and half ranges that are passed, in their order
    halves = (after >> bits - 1) - (before >> bits - 1)
    wraps = (after >> bits) - (before >> bits)
    first = np.repeat((before >> bits - 1) + 1 - (np.cumsum(halves) - halves), halves)
    is_wrap = (first + np.arange(len(first))) % 2 == 0
    words = np.empty((len(first), 2), np.int64)
    words[:, 0] = np.where(is_wrap, (1 << bits) - 1, 1 << bits - 1)
    words[:, 1] = 0
    is_sent = np.stack([np.ones_like(is_wrap), is_wrap], 1)
    return halves + wraps, words[is_sent]


def unwrap_counter(raw: npt.NDArray[Any], last: int, bits: int) -> Integers:
    """Undo the wraps of a counter.

    A fall by more than half of the range is a wrap. A smaller one is a step back, as the time
    stamps of real cameras make at times.

    Args:
        raw: (n,) values of the counter.
        last: The value before them, with its wraps; -1 for none.
        bits: Bits of the counter.

    Returns:
        (n,) int64 values with their wraps counted.
    """
    mask = (1 << bits) - 1
    first = int(raw[0]) if last < 0 and len(raw) else last
    known = np.concatenate([[first & mask], raw.astype(np.int64)])
    wraps = np.cumsum(known[:-1] - known[1:] > mask >> 1)
    counted: Integers = known[1:] + ((wraps + (max(last, 0) >> bits)) << bits)
    return counted
