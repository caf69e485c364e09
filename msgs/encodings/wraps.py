"""Counters that wrap: how EVT2 and EVT3 tell the upper bits of time, and how to read them.

A TIME_HIGH word holds the upper bits of the time, but only so many; a decoder counts how often they
wrapped. Decoders differ in what they take for a wrap: some want a fall from nearly the largest
number to nearly zero, some any fall by more than ten. An encoder that says the largest number and
zero at each wrap is understood by all of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]


def told_between(before: Integers, after: Integers, bits: int) -> tuple[Integers, Integers]:
    """What to say so that a decoder that knows `before` counts up to `after`.

    In: before, after (n,) upper bits of time without wraps, before <= after; bits of the counter.
    Out: how many words at each place (n,), and the words (their sum,): largest, zero, largest, ...
    """
    counts = 2 * ((after >> bits) - (before >> bits))
    words = np.zeros(int(counts.sum()), np.int64)
    words[0::2] = (1 << bits) - 1
    return counts, words


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
