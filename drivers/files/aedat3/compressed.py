"""cAER's compressed packets (`#Format: Serial-TS`, `Compressed`), expanded.

Polarity: three or more events of one stamp follow each other as a run: the first has bit 31 of its
stamp set, the second has instead of its stamp how many more there are, and of those only the data
is there, 4 bytes each. Frames: where bit 31 of a frame's info is set, behind its head there are
i32 bytes and so much of a PNG file, 16 bits grey, instead of the pixels. Source: cAER's input and
output modules.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from evs.drivers.files.aedat3.layout import EVENT

FORMATS = ("RAW", "Serial-TS", "Compressed", "PNG", "Serial-TS,PNG")
"""the known values of a header's format line"""

PNG_BIT = 1 << 31
_RUN = 1 << 31
_TIME = _RUN - 1
MAX_PICTURE_BYTES = 1 << 26
"""most bytes of a decompressed frame, 32 megapixels"""

MAX_DEFLATE = 1100
"""deflate expands at most 1032 times; a picture that states more is corrupt"""


def expanded(body: bytes, count: int) -> npt.NDArray[np.void] | None:
    """(count,) EVENT of a compressed polarity packet; None where the bytes do not hold as many."""
    if len(body) % 4:
        return None
    words = np.frombuffer(body, "<u4")
    runs = _runs(words)
    if runs is None:
        return None
    begins, more = runs
    # one event takes two words, but those of a run behind its second take one
    stamped = np.ones(len(words), np.bool_)
    lengths = 4 + more
    inside = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    where = np.repeat(begins, lengths) + inside
    stamped[where] = False
    is_data = np.zeros(len(words), np.bool_)
    plain = np.flatnonzero(stamped)
    is_data[plain[::2]] = True
    is_data[where[(inside != 1) & (inside != 3)]] = True
    if int(np.count_nonzero(is_data)) != count:
        return None
    events = np.empty(count, EVENT)
    events["data"] = words[is_data]
    # where each word's event has its stamp
    stamp_at = np.arange(len(words)) + 1
    stamp_at[where] = np.repeat(begins + 1, lengths)
    events["stamp"] = words[stamp_at[is_data]] & _TIME
    return events


def _runs(
    words: npt.NDArray[np.uint32],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]] | None:
    """Start of each run and its number of events after the second; None: they do not fit."""
    marked = np.flatnonzero(words >= _RUN)
    # stamps lie at odd distances from where the events before them began
    by_parity = [marked[marked % 2 == parity] for parity in (0, 1)]
    begins: list[int] = []
    more: list[int] = []
    at, count = 0, len(words)
    while at < count:
        stamps = by_parity[(at + 1) % 2]
        following = int(np.searchsorted(stamps, at + 1))
        if following == len(stamps):
            # plain events up to the end
            return (
                (np.array(begins, np.int64), np.array(more, np.int64))
                if (count - at) % 2 == 0
                else None
            )
        begin = int(stamps[following]) - 1
        if begin + 4 > count:
            return None
        length = int(words[begin + 3])
        at = begin + 4 + length
        if at > count:
            return None
        begins.append(begin)
        more.append(length)
    return np.array(begins, np.int64), np.array(more, np.int64)
