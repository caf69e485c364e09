"""libcaer_cmp, how libcaer_driver packs a DAVIS's events: words of 16 bits, little-endian.

Bits 15-12 are the type of a word, the others its value:

    0 TIME_HIGH    bits 23-12 of the time since the packet's time base, us; 0 when a packet begins
    1 TIME_LOW     bits 11-0 of it; stays when the upper bits change
    2 ADDR_X       bits 10-0 x of the events that follow
    3 ADDR_Y       bits 10-0 y, bit 11 polarity: one event
    4 VECT_BASE_Y  bits 10-0 y, bit 11 polarity, of the vectors that follow
    5 VECT_8       bit k: an event at base + k; then the base moves on by 8
The time base is the packet's first stamp, ns. Source: libcaer_driver and event_camera_codecs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.codecs.counter_wraps import unwrap_counter
from evs.msgs.event import Events, empty_events

_HIGH, _LOW, _X, _Y, _BASE, _VECTOR = range(6)
_BITS = 12

NO_X = 0x7FFF
"""x of events before the first ADDR_X, and y of those too far down: on no sensor."""


def decode_libcaer_cmp(data: Any, time_base_ns: int) -> Events:
    """Decode one packet. Never raises.

    Args:
        data: Any contiguous buffer of whole words; an odd last byte is ignored.
        time_base_ns: Time base of the packet, ns.

    Returns:
        (n,) events in the order of the words.
    """
    words = np.frombuffer(data, "<u2", memoryview(data).nbytes // 2)
    kinds, values = words >> _BITS, (words & 0xFFF).astype(np.int64)
    high = _last(kinds == _HIGH, unwrap_counter(values[kinds == _HIGH], 0, _BITS), 0)
    low = _last(kinds == _LOW, values[kinds == _LOW], 0)
    x = _last(kinds == _X, values[kinds == _X] & 0x7FF, NO_X)
    # where a vector begins: moved on by the vectors since its base
    is_vector = kinds == _VECTOR
    moved = 8 * np.cumsum(is_vector)
    base_values = values[kinds == _BASE]
    base = _last(kinds == _BASE, (base_values & 0x7FF) - moved[kinds == _BASE], NO_X)
    on = _last(kinds == _BASE, base_values >> 11, 0)
    # one row of pixels a word: a single event fills one of eight
    places = np.flatnonzero(is_vector | (kinds == _Y))
    single, value = kinds[places] == _Y, values[places]
    valid = np.where(single, 1, value & 0xFF).astype(np.uint8)
    bits = np.unpackbits(valid, bitorder="little").reshape(-1, 8).view(np.bool_)
    row, k = np.nonzero(bits)
    first = np.where(single, value & 0x7FF, base[places] + moved[places] - 8)
    events = empty_events(len(row))
    events["t"] = time_base_ns // 1000 + (high << _BITS | low)[places][row]
    events["x"] = x[places][row]
    events["y"] = np.minimum(first[row] + k, NO_X)
    events["p"] = np.where(single, value >> 11, on[places])[row]
    return events


def _last(
    is_update: npt.NDArray[np.bool_], values: npt.NDArray[np.int64], begin: int
) -> npt.NDArray[np.int64]:
    """The value that applies at each word, (n,): that of the last update, `begin` before it."""
    held: npt.NDArray[np.int64] = np.concatenate([[begin], values])[np.cumsum(is_update)]
    return held
