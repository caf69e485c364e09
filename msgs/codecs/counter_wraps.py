"""Counters that wrap: how EVT2 and EVT3 encode the upper bits of time, and how to decode them.

A TIME_HIGH word holds a limited number of upper bits of the time; a decoder counts how often they
have wrapped. Decoders differ in what they treat as a wrap: some require a fall from nearly the
largest number to nearly zero, others any fall by more than ten, and some treat a rise from nearly
zero to nearly the largest number as a step back. All of them understand an encoder that sends half
of the range each time it is passed, and the largest number and zero at each wrap.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]


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
