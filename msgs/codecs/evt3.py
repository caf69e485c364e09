"""EVT3, Prophesee's format of 16-bit words, little-endian: type in bits 15-12, then its value.

    0 ADDR_Y       bits 10-0 y; stays for the events that follow
    2 ADDR_X       bits 10-0 x, bit 11 polarity: one event
    3 VECT_BASE_X  bits 10-0 x, bit 11 polarity, of the vectors that follow
    4 VECT_12      bit k: an event at base + k; then the base moves on by 12
    5 VECT_8       the same, 8 pixels
    6 TIME_LOW     bits 11-0 of the time, us
    8 TIME_HIGH    bits 23-12 of the time; wraps every 16.8 s
    10 EXT_TRIGGER bits 11-8 input, bit 0: the edge rises
Others (counters, padding) are not about events and are skipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.codecs.codec import Codec, Payload
from evs.msgs.codecs.counter_wraps import encode_in_blocks, insert_counter_words, unwrap_counter
from evs.msgs.codecs.limits import (
    LONGEST_US,
    MAX_SIDE_EVT_PX,
    TIME_ORIGIN_US,
    EncodingLimits,
)
from evs.msgs.event import Events, empty_events, join_events
from evs.msgs.trigger import Triggers, external_triggers

EVT3 = EncodingLimits("EVT3", MAX_SIDE_EVT_PX, MAX_SIDE_EVT_PX, LONGEST_US)

_Y, _X, _BASE, _VECT_12, _VECT_8, _LOW, _HIGH, _TRIGGER = 0, 2, 3, 4, 5, 6, 8, 10
_BITS = 12
_WORDS = 1 << 15
"""Words decoded at once."""

Words = npt.NDArray[np.uint16]


def encode_evt3(
    events: Events, *, time_origin_us: int = TIME_ORIGIN_US, after_us: int | None = None
) -> bytes:
    """Encode a packet as EVT3 words; it begins with the whole time and the row.

    Args:
        events: (n,) EVENT_DTYPE, sorted by t.
        time_origin_us: Time stamp of the stream's time zero, us.
        after_us: Time of the stream's last packet, us, for encoding wraps of the counter since
            then; -time_origin_us for the first packet of a file, which then encodes the time from
            zero; None: the decoder starts counting here.

    Returns:
        The bytes; empty for no events.

    Raises:
        MessageError: x or y is over 2047, a time stamp is negative, or time steps back.
    """
    return encode_in_blocks(events, EVT3, time_origin_us, after_us, _high_word, _block)


def _block(events: Events, stamps: npt.NDArray[np.int64], known_us: int) -> Words:
    """The words of some events, after those that bring a decoder from `known_us` here."""
    high = stamps >> _BITS
    x, y = events["x"].view(np.uint16), events["y"].view(np.uint16)
    # up to four words for each event, of which only those with new content are sent
    words = np.empty((len(events), 4), "<u2")
    words[:, 0] = (high & 0xFFF) | _HIGH << 12
    words[:, 1] = (stamps & 0xFFF) | _LOW << 12
    words[:, 2] = y
    words[:, 3] = x | _X << 12
    words[:, 3] |= (events["p"] != 0).astype(np.uint16) << 11
    is_sent = np.ones((len(events), 4), bool)
    np.not_equal(high[1:], high[:-1], out=is_sent[1:, 0])
    np.not_equal(stamps[1:], stamps[:-1], out=is_sent[1:, 1])
    np.not_equal(y[1:], y[:-1], out=is_sent[1:, 2])
    return insert_counter_words(words, is_sent, high, known_us >> _BITS, _BITS, _high_words)


def _high_word(t_us: int) -> Words:
    return _high_words(np.array([t_us >> _BITS]))


def _high_words(high: npt.NDArray[np.int64]) -> Words:
    return ((high & 0xFFF) | _HIGH << 12).astype("<u2")


@dataclass(frozen=True)
class Evt3State:
    """The state of a decoder between two pieces of a stream."""

    high: int = -1
    """upper bits of the time, wraps counted; -1: not known yet"""
    low: int = 0
    """lower 12 bits of the time"""
    y: int = -1
    """row of the next event; -1: not known yet"""
    base: int = 0
    """x of the next vector's first pixel"""
    on: int = 0
    """polarity of the next vector"""
    skipped: int = 0
    """events so far without a time stamp or a row, or beyond x = 2047"""


def decode_evt3(
    data: Any,
    state: Evt3State | None = None,
    *,
    time_origin_us: int = TIME_ORIGIN_US,
    triggers: list[Triggers] | None = None,
) -> tuple[Events, Evt3State]:
    """Decode a piece of an EVT3 stream. No words make it raise.

    Args:
        data: Any contiguous buffer of whole words; an odd last byte is ignored.
        state: The state after the piece before; None: the stream starts here.
        time_origin_us: Time stamp of the stream's time zero, us.
        triggers: A list that takes the array of external triggers in the piece, (m,); those before
            the first time stamp are left out.

    Returns:
        (n,) events in the order of the words, which may be unsorted, and the next state.
    """
    state = state or Evt3State()
    words = np.frombuffer(data, "<u2", memoryview(data).nbytes // 2)
    parts = []
    for start in range(0, len(words), _WORDS):
        part, state = _piece(words[start : start + _WORDS], state, time_origin_us, triggers)
        parts.append(part)
    return parts[0] if len(parts) == 1 else join_events(parts), state


def _piece(
    words: Words, state: Evt3State, time_origin_us: int, triggers: list[Triggers] | None
) -> tuple[Events, Evt3State]:
    """decode_evt3 of not many words, at least one."""
    kinds = (words >> 12).astype(np.uint8)
    stamps, numbers, high, low = _times(words, kinds, state)
    if triggers is not None and len(marks := np.flatnonzero(kinds == _TRIGGER)):
        marks_t = stamps[numbers[marks]]
        marks, marks_t = marks[marks_t >= 0], marks_t[marks_t >= 0]
        triggers.append(external_triggers(marks_t - time_origin_us, words[marks] & 1))
    is_row = kinds == _Y
    rows = np.concatenate([[state.y], words[is_row] & 0x7FF]).astype(np.int16)
    is_vector = (kinds == _VECT_12) | (kinds == _VECT_8)
    base, on = state.base, state.on
    if is_vector.any() or (kinds == _BASE).any():
        places, x, p, base, on = _with_vectors(words, kinds, is_vector, state)
    else:
        places = np.flatnonzero(kinds == _X)
        selected = words[places]
        x, p = selected & 0x7FF, selected >> 11 & 1
    t, y = stamps[numbers[places]], rows[np.cumsum(is_row, dtype=np.int32)[places]]
    skipped = 0
    if state.high < 0 or state.y < 0 or is_vector.any():
        right = (t >= 0) & (y >= 0) & (x < MAX_SIDE_EVT_PX)
        skipped = len(right) - int(np.count_nonzero(right))
        t, x, y, p = t[right], x[right], y[right], p[right]
    events = empty_events(len(t))
    np.subtract(t, time_origin_us, out=events["t"])
    events["x"], events["y"], events["p"] = x, y, p
    next_state = Evt3State(high, low, int(rows[-1]), base, on, state.skipped + skipped)
    return events, next_state


def _times(
    words: Words, kinds: npt.NDArray[np.uint8], state: Evt3State
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32], int, int]:
    """The time stamps that occur, in order, -1 where unknown; for each word, which of them applies.

    Then the upper and the lower bits at the end.
    """
    is_time = (kinds == _LOW) | (kinds == _HIGH)
    time_words, is_high = words[is_time] & 0xFFF, kinds[is_time] == _HIGH
    highs = np.concatenate([[state.high], unwrap_counter(time_words[is_high], state.high, _BITS)])
    high_number = np.concatenate([[0], np.cumsum(is_high)])
    high = highs[high_number]
    # a new upper part starts at 0 until a lower one follows; a repeated one does not
    low = np.concatenate([[state.low], time_words]).astype(np.int64)
    repeated = np.concatenate([[False], is_high & (high[1:] == high[:-1])])
    low[1:][is_high] = 0
    if repeated.any():
        last_sent = np.maximum.accumulate(np.where(repeated, 0, np.arange(len(low))))
        low = low[last_sent]
    stamps = np.where(high < 0, -1, high << _BITS | low)
    return stamps, np.cumsum(is_time, dtype=np.int32), int(high[-1]), int(low[-1])


def _with_vectors(
    words: Words, kinds: npt.NDArray[np.uint8], is_vector: npt.NDArray[np.bool_], state: Evt3State
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int8], int, int]:
    """Place of the word, x and polarity of each event, where vectors are among the words.

    Then the base and the polarity for the next vector.
    """
    # the base of each word, and how far vectors have moved it since
    moved = np.cumsum(np.where(is_vector, np.where(kinds == _VECT_12, 12, 8), 0), dtype=np.int64)
    is_base = kinds == _BASE
    base_words = words[is_base].astype(np.int64)
    bases = np.concatenate([[state.base], (base_words & 0x7FF) - moved[is_base]])
    signs = np.concatenate([[state.on], base_words >> 11 & 1]).astype(np.int8)
    number = np.cumsum(is_base, dtype=np.int32)
    # one row of pixels a word: a single event fills one of twelve
    places = np.flatnonzero(is_vector | (kinds == _X))
    kind, word = kinds[places], words[places]
    single = kind == _X
    valid = np.where(single, 1, word & np.where(kind == _VECT_12, 0xFFF, 0xFF))
    pixels = (valid[:, None] >> np.arange(12, dtype=np.uint16) & 1).astype(bool)
    row, k = np.nonzero(pixels)
    before = moved[places] - np.where(kind == _VECT_12, 12, 8)
    first = np.where(single, word & 0x7FF, bases[number[places]] + before)
    sign = np.where(single, word >> 11 & 1, signs[number[places]]).astype(np.int8)
    end = int(moved[-1]) if len(moved) else 0
    return places[row], first[row] + k, sign[row], int(bases[-1]) + end, int(signs[-1])


class Evt3(Codec):
    """evt3 in event_camera_msgs, whose time base is 0: the words hold the time."""

    limits = EVT3
    about = "metavision_driver's"
    has_clock = True

    def __init__(self, time_origin_us: int) -> None:
        """Start a stream."""
        super().__init__(time_origin_us)
        self._after_us = -time_origin_us
        self._state = Evt3State()

    def encode(self, events: Events, time_base_us: int | None) -> Payload:
        """Encode a packet; its words continue the last one's."""
        del time_base_us
        data = encode_evt3(events, time_origin_us=self.time_origin_us, after_us=self._after_us)
        if len(events):
            self._after_us = int(events["t"][-1])
        return Payload(0, data)

    def decode(self, data: Any, time_base_ns: int, triggers: list[Triggers] | None) -> Events:
        """Decode a packet, or any piece of one of whole words."""
        del time_base_ns
        events, self._state = decode_evt3(
            data, self._state, time_origin_us=self.time_origin_us, triggers=triggers
        )
        self.skipped = self._state.skipped
        return events
