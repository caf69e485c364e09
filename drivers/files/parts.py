"""Events as readers find them in a file's pieces, cut into the parts that they hand out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from evs.drivers.files.recorded import by_tick
from evs.msgs import Events, clean_events, empty_events, join_events

MAX_HELD = 1 << 20
"""Events of one tick that are kept together across the pieces of a file."""


def in_order(events: Events) -> Events:
    """The events, (n,), sorted by t, those of one time in the order that they came in."""
    stamps = events["t"]
    if (stamps[1:] >= stamps[:-1]).all():
        return events
    return clean_events(events[np.argsort(stamps, kind="stable")])


def ticks_of(pieces: Iterable[Events], tick_us: int) -> Iterator[Events]:
    """Pieces of a stream, cut into ticks: each part is sorted and not empty, whatever came in.

    A tick that a piece's end cuts in two is put together again.
    """
    held = empty_events()
    for piece in pieces:
        joined = in_order(join_events([held, piece]) if len(held) else piece)
        if not len(joined):
            continue
        tick_begin_us = -(-int(joined["t"][-1]) // tick_us) * tick_us - tick_us
        cut = int(np.searchsorted(joined["t"], tick_begin_us, side="right"))
        cut = len(joined) if len(joined) - cut > MAX_HELD else cut
        yield from by_tick(joined[:cut], tick_us)
        held = joined[cut:].copy() if cut else joined
    yield from by_tick(clean_events(held), tick_us)


def on_sensor(events: Events, width: int, height: int) -> tuple[Events, int]:
    """The events that lie on a sensor of this size, px, and how many do not."""
    right = (events["x"].view(np.uint16) < width) & (events["y"].view(np.uint16) < height)
    wrong = len(events) - int(np.count_nonzero(right))
    return (clean_events(events[right]), wrong) if wrong else (events, 0)
