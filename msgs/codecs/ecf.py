"""ECF, the codec of Metavision's HDF5 files: up to 65,535 events at once, little-endian.

    u32      number of events << 2; bit 1: y, x and polarity are packed; bit 0: x and polarity are
    i64      time of the first event, us
    t        bytes: upper half a step, us, lower half how many events have the time; 15: the number
             is in the next 2 bytes. Step 15: the lower half is 4 more bits of the next step, from
             the lowest on
  packed:
    y, x, p  3 words of 32 bits for 4 events of 24 bits, y << 12 | x << 1 | p
  else:
    y        words of 16 bits: y << 5 | how many events; 31: the number is the next word
    x, p     packed: 3 words of 16 bits for 4 events of 12 bits, x << 1 | p
    x        else: words of 16 bits, x << 5; bit 4 - k: there is another event at x + k + 1
    p        and bytes: p << 7 | how many events; 127: the number is in the next 2 bytes

The encoder packs y, x and p, which costs 3 to 5 bytes an event in any order of pixels. Source: the
codec that Prophesee publishes with its HDF5 filter.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.codecs.limits import EncodingLimits, check_fits
from evs.msgs.codecs.variable_length import code_starts
from evs.msgs.event import Events, make_events
from evs.msgs.header_fields import MessageError

ECF = EncodingLimits("ECF", 1 << 11, 1 << 11, 1 << 62)

MAX_EVENTS = (1 << 16) - 1
"""events that are encoded together"""

_ALL_PACKED, _XP_PACKED = 2, 1
_HEAD_BYTES = 12
_LONG_STEP, _LONG_COUNT = 15, 15
_STEP_DIGITS = 16
"""most digits of 4 bits in a step"""

Integers = npt.NDArray[np.int64]
Bytes = npt.NDArray[np.uint8]


def encode_ecf(events: Events) -> bytes:
    """Encode events.

    Args:
        events: (n,) EVENT_DTYPE with 0 < n <= MAX_EVENTS, sorted by t.

    Returns:
        The bytes of a chunk.

    Raises:
        MessageError: There are no or too many events, they are not sorted, or they do not fit.
    """
    if not 0 < len(events) <= MAX_EVENTS:
        raise MessageError(f"ECF encodes 1 ... {MAX_EVENTS} events at once, got {len(events)}")
    check_fits(events, ECF)
    head = np.array([len(events) << 2 | _ALL_PACKED], "<u4").tobytes()
    first = events["t"][:1].astype("<i8").tobytes()
    y, x, p = (events[name].astype(np.uint32) for name in "yxp")
    packed = _pack(y << 12 | x << 1 | (p != 0), 8, "<u4")
    return head + first + _encode_times(events["t"]).tobytes() + packed


def _encode_times(t: Integers) -> Bytes:
    """The codes of sorted time stamps, (n,)."""
    begins = np.flatnonzero(np.diff(t, prepend=t[0] - 1))
    counts = np.diff(begins, append=len(t))
    steps = np.diff(t[begins], prepend=t[0])
    # a long step stands before the code of its time, which then has step 0
    is_long = steps >= _LONG_STEP
    digits = np.where(is_long, 1 + np.log2(np.maximum(steps, 1)).astype(np.int64) // 4, 0)
    digits += is_long & (steps >> 4 * digits > 0)
    many = counts >= _LONG_COUNT
    sizes = digits + np.where(many, 3, 1)
    at = np.cumsum(sizes) - sizes
    codes = np.zeros(int(sizes.sum()), np.uint8)
    for digit in range(int(digits.max())):
        has = digits > digit
        codes[at[has] + digit] = _LONG_STEP << 4 | (steps[has] >> 4 * digit) & 15
    at += digits
    codes[at] = np.where(is_long, 0, steps) << 4 | np.minimum(counts, _LONG_COUNT)
    codes[at[many] + 1], codes[at[many] + 2] = counts[many] & 255, counts[many] >> 8
    return codes


def _pack(values: npt.NDArray[np.uint32], part: int, dtype: str) -> bytes:
    """Pack values of 3 * part bits, (n,): 4 into 3 words of 4 * part bits; n is rounded up to 4."""
    a, b, c, d = np.resize(values, -(-len(values) // 4) * 4).reshape(-1, 4).T
    low = (1 << part) - 1
    words = np.empty((len(a), 3), dtype)
    words[:, 0] = a << part | b & low
    words[:, 1] = b >> part << 2 * part | c & (low << part | low)
    words[:, 2] = c >> 2 * part << 3 * part | d
    return words.tobytes()


def decode_ecf(data: Any) -> Events:
    """Decode the bytes of a chunk.

    Args:
        data: Any contiguous buffer.

    Returns:
        (n,) events in the order encoded, which may be unsorted.

    Raises:
        MessageError: The bytes are damaged.
    """
    whole = np.frombuffer(data, np.uint8)
    if len(whole) < _HEAD_BYTES:
        raise MessageError(f"ECF: a chunk of {len(whole)} bytes has no header")
    head = int(whole[:4].view("<u4")[0])
    count, packing = head >> 2, head & 3
    if count > MAX_EVENTS:
        raise MessageError(f"ECF: a chunk states {count} events")
    t, rest = _decode_times(int(whole[4:_HEAD_BYTES].view("<i8")[0]), whole[_HEAD_BYTES:], count)
    if packing & _ALL_PACKED:
        values, _ = _unpack(rest, 8, "<u4", count)
        return make_events(t, values >> 1 & 0x7FF, values >> 12 & 0x7FF, values & 1)
    words = rest[: len(rest) // 2 * 2].view("<u2")
    y, used = _repeated(words, 31, 1, words & 31, words >> 5, count)
    rest = rest[2 * used :]
    if packing & _XP_PACKED:
        values, _ = _unpack(rest, 4, "<u2", count)
        return make_events(t, values >> 1, y, values & 1)
    x, rest = _decode_masks(rest, count)
    p, _ = _repeated(rest, 127, 2, rest & 127, rest >> 7, count)
    return make_events(t, x, y, p)


def _decode_times(first: int, codes: Bytes, count: int) -> tuple[Integers, Bytes]:
    """Time stamps, (count,), and the bytes after their codes."""
    step, number = codes >> 4, codes & 15
    is_digit = step == _LONG_STEP
    numbers = np.where(is_digit, 0, number)
    starts, counts, used = _runs(codes, _LONG_COUNT, 2, numbers, count)
    is_digit, number = is_digit[starts], number[starts].astype(np.int64)
    # the place of each digit in its step
    every = np.arange(len(starts))
    places = every - np.maximum.accumulate(np.where(is_digit, -1, every)) - 1
    if int(places[is_digit].max(initial=0)) >= _STEP_DIGITS:
        raise MessageError("ECF: a step in time is too long")
    steps = np.where(is_digit, number << 4 * np.maximum(places, 0), step[starts])
    return np.repeat(first + np.cumsum(steps), counts), codes[used:]


def _decode_masks(data: Bytes, count: int) -> tuple[Integers, Bytes]:
    """x of events, (count,), and the bytes after them."""
    words = data[: len(data) // 2 * 2].view("<u2").astype(np.int64)
    has = np.empty((len(words), 6), bool)
    has[:, 0] = True
    for k in range(5):
        has[:, k + 1] = words >> 4 - k & 1
    used = int(np.searchsorted(np.cumsum(has.sum(1)), count)) + 1 if count else 0
    word, later = np.nonzero(has[:used])
    if len(word) < count:
        raise MessageError("ECF: a chunk ends within x")
    # the last word may state more events than there are
    return ((words[word] >> 5) + later)[:count], data[2 * used :]


def _repeated(
    units: npt.NDArray[Any], long: int, more: int, numbers: Any, values: Any, count: int
) -> tuple[Integers, int]:
    """Values, (count,), of codes that repeat them, and how many units the codes have."""
    starts, counts, used = _runs(units, long, more, numbers, count)
    return np.repeat(values[starts].astype(np.int64), counts), used


def _runs(
    units: npt.NDArray[Any], long: int, more: int, numbers: npt.NDArray[Any], count: int
) -> tuple[Integers, Integers, int]:
    """Codes of repetitions, up to the one that completes the events.

    Args:
        units: (m,) bytes or words.
        long: The number that stands for a long one, which is in the next units.
        more: How many units those are, 1 or 2, the lower first.
        numbers: (m,) what each unit states, if a code begins there.
        count: How many events there are.

    Returns:
        (k,) where codes begin, (k,) the repetitions of each, and how many units they have.

    Raises:
        MessageError: The repetitions do not add up to `count`.
    """
    is_long = numbers == long
    sizes = np.where(is_long, 1 + more, 1)
    starts = code_starts(sizes)
    starts = starts[starts + sizes[starts] <= len(units)]
    later = np.append(units, [0, 0]).astype(np.int64)
    long_numbers = later[1:-1] if more == 1 else later[1:-1] | later[2:] << 8
    counts = np.where(is_long, long_numbers, numbers)[starts]
    total = np.cumsum(counts)
    last = int(np.searchsorted(total, count)) if count else -1
    if count and (last == len(total) or total[last] != count):
        raise MessageError(f"ECF: the codes of a chunk are not of its {count} events")
    used = int(starts[last] + sizes[starts[last]]) if count else 0
    return starts[: last + 1], counts[: last + 1], used


def _unpack(data: Bytes, part: int, dtype: str, count: int) -> tuple[Integers, Bytes]:
    """The reverse of `_pack`: (count,) values, and the bytes after them."""
    size = -(-count // 4) * 3 * np.dtype(dtype).itemsize
    if len(data) < size:
        raise MessageError("ECF: a chunk ends within x")
    a, b, c = data[:size].view(dtype).reshape(-1, 3).T.astype(np.int64)
    low = (1 << part) - 1
    values = np.empty((len(a), 4), np.int64)
    values[:, 0] = a >> part
    values[:, 1] = a & low | b >> 2 * part << part
    values[:, 2] = b & (low << part | low) | c >> 3 * part << 2 * part
    values[:, 3] = c & (1 << 3 * part) - 1
    return values.ravel()[:count], data[size:]
