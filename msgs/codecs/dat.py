"""DAT, Prophesee's format of 8 bytes an event: u32 time, us, then u32 with x, y and polarity.

    version 2  bits 0-13 x, 14-27 y, 28-31 polarity
    version 1  bits 0-8 x, 9-16 y, 17 polarity
Time wraps every 4,295 s; a decoder detects it by a falling time stamp. Source:
Prophesee's description.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.msgs.codecs.limits import EncodingLimits, check_fits
from evs.msgs.event import Events, empty_events
from evs.msgs.header_fields import MessageError

WRAP_US = 1 << 32
MAX_SIDE_DAT_PX = (1 << 14) - 1
"""One less than there are bits for: others count it as the end."""

DAT = EncodingLimits("DAT", MAX_SIDE_DAT_PX, MAX_SIDE_DAT_PX, 1 << 62)

_ROW = np.dtype([("t", "<u4"), ("data", "<u4")])
_BITS = {1: (9, 8), 2: (14, 14)}
"""version -> bits of x and of y"""


def encode_dat(events: Events, *, after_us: int = 0) -> bytes:
    """Encode a packet.

    Args:
        events: (n,) EVENT_DTYPE, sorted by t.
        after_us: Time stamp of the event before, us; 0 for none.

    Raises:
        MessageError: The events are not sorted, do not fit, or follow so late that a decoder cannot
            see the wrap of the time.
    """
    check_fits(events, DAT)
    if not len(events):
        return b""
    gaps = np.diff(events["t"], prepend=after_us)
    if int(gaps.min()) < 0 or int(gaps.max()) >= WRAP_US:
        gap = gaps[gaps < 0][0] if int(gaps.min()) < 0 else gaps.max()
        raise MessageError(f"DAT needs an event every {WRAP_US} us, the next comes after {gap} us")
    rows = np.empty(len(events), _ROW)
    rows["t"] = events["t"] & WRAP_US - 1
    x, y = events["x"].astype(np.uint32), events["y"].astype(np.uint32)
    rows["data"] = x | y << 14 | (events["p"] != 0).astype(np.uint32) << 28
    return rows.tobytes()


@dataclass(frozen=True)
class DatState:
    """The state of a decoder between two pieces of a stream."""

    last_us: int = 0
    """the last stamp, wraps counted"""


def decode_dat(
    data: Any, state: DatState | None = None, *, version: int = 2, ordered: bool = False
) -> tuple[Events, DatState]:
    """Decode a piece of a stream.

    Args:
        data: Any contiguous buffer of whole events; up to 7 last bytes are ignored.
        state: The state after the piece before; None: the stream starts here.
        version: Version of the format, 1 or 2.
        ordered: Whether every fall of the time is a wrap. If not, a fall by more than half of the
            range is one, and a rise by more than that goes back over a wrap: a real camera's time
            stamps step back at times.

    Returns:
        (n,) events, and the next state.
    """
    last_us = 0 if state is None else state.last_us
    rows = np.frombuffer(data, _ROW, memoryview(data).nbytes // _ROW.itemsize)
    events = empty_events(len(rows))
    if not len(rows):
        return events, DatState(last_us)
    raw = rows["t"].astype(np.int64)
    falls = np.diff(raw, prepend=last_us % WRAP_US)
    if ordered:
        wraps = np.cumsum(falls < 0) + last_us // WRAP_US
    else:
        steps = (falls < -WRAP_US // 2).astype(np.int64) - (falls > WRAP_US // 2)
        wraps = np.cumsum(steps) + last_us // WRAP_US
        # before the first wrap there is nothing to step back to
        wraps -= np.minimum(np.minimum.accumulate(wraps), 0)
    events["t"] = raw + wraps * WRAP_US
    x_bits, y_bits = _BITS[version]
    word = rows["data"]
    events["x"] = word & (1 << x_bits) - 1
    events["y"] = word >> x_bits & (1 << y_bits) - 1
    events["p"] = word >> x_bits + y_bits & (1 if version == 1 else 15) != 0
    return events, DatState(int(events["t"][-1]))
