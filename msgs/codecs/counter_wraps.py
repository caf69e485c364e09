"""Counters that wrap: how EVT2 and EVT3 tell the upper bits of time, and how to read them.

A TIME_HIGH word holds the upper bits of the time, but only so many; a decoder counts how often they
wrapped. Decoders differ in what they take for a wrap: some want a fall from nearly the largest
number to nearly zero, some any fall by more than ten; and some take a rise from nearly zero to
nearly the largest number for a step back. An encoder that says half of the range each time it is
passed, and the largest number and zero at each wrap, is understood by all of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]


def told_between(before: Integers, after: Integers, bits: int) -> tuple[Integers, Integers]:
    """What to say so that a decoder that knows `before` counts up to `after`.

    In: before, after (n,) upper bits of time without wraps, before <= after; bits of the counter.
    Out: how many words at each place (n,), and the words (their sum,): half, largest, zero, ...
    """
    # whole and half ranges that are passed, in their order
    halves = (after >> bits - 1) - (before >> bits - 1)
    wraps = (after >> bits) - (before >> bits)
    first = np.repeat((before >> bits - 1) + 1 - (np.cumsum(halves) - halves), halves)
    is_wrap = (first + np.arange(len(first))) % 2 == 0
    words = np.empty((len(first), 2), np.int64)
    words[:, 0] = np.where(is_wrap, (1 << bits) - 1, 1 << bits - 1)
    words[:, 1] = 0
    said = np.stack([np.ones_like(is_wrap), is_wrap], 1)
    return halves + wraps, words[said]


def unwrapped(raw: npt.NDArray[Any], last: int, bits: int) -> Integers:
    """Upper bits of time with their wraps counted.

    In: raw (n,) as the words have them; last: the number before them, with its wraps, -1 for none.
    Out: (n,). A fall by more than half the range is a wrap; a smaller one is taken for what it
    says: the stamps of real cameras step back at times.
    """
    mask = (1 << bits) - 1
    first = int(raw[0]) if last < 0 and len(raw) else last
    known = np.concatenate([[first & mask], raw.astype(np.int64)])
    wraps = np.cumsum(known[:-1] - known[1:] > mask >> 1)
    told: Integers = known[1:] + ((wraps + (max(last, 0) >> bits)) << bits)
    return told
