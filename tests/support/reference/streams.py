"""Recordings: events at random, and a Hypothesis strategy for a stream and its packets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

from evs.msgs import EventPacket, Events, StreamInfo, make_events

EDGES_US = (0, 1, 999, 1000, 2**24, 2**31, 2**32, 2**33, 2**34 - 1_000_000)
"""Stamps at which something wraps in one format or another, us."""


def random_events(
    count: int, begin_us: int, end_us: int, size: tuple[int, int] = (346, 260), seed: int = 0
) -> Events:
    """Make sorted events, begin_us < t <= end_us, the first two in corners of the sensor."""
    random = np.random.default_rng([seed, count])
    t = np.sort(random.integers(begin_us + 1, end_us + 1, count, dtype=np.int64))
    x, y, p = (random.integers(0, side, count) for side in (*size, 2))
    x[:2], y[:2] = (0, size[0] - 1)[:count], (0, size[1] - 1)[:count]
    return make_events(t, x, y, p)


def random_packet(
    seq: int,
    count: int,
    size: tuple[int, int] = (346, 260),
    camera: str = "eye",
    start_us: int = 0,
) -> EventPacket:
    """Make the packet of a tick of 1 ms, of random events that are others in each tick."""
    begin = start_us + 1000 * seq
    events = random_events(count, begin, begin + 1000, size, seq)
    return EventPacket(seq, begin, begin + 1000, *size, events, camera)


@st.composite
def streams(
    draw: st.DrawFn,
    width: int,
    height: int,
    edges_us: Sequence[int] = EDGES_US,
    step_us: int = 2**30,
) -> tuple[StreamInfo, list[Events]]:
    """Draw a stream and its packets: sorted, and near a stamp at which something wraps or far away.

    Args:
        draw: Given by Hypothesis.
        width: The largest width of the sensor, px.
        height: The largest height of the sensor, px.
        edges_us: Stamps at which something wraps.
        step_us: The longest pause between two events.
    """
    stream = StreamInfo(
        draw(st.integers(1, width)),
        draw(st.integers(1, height)),
        camera=draw(st.text(min_size=1, max_size=8)),
        tick_us=draw(st.sampled_from([1, 1000, 123_456])),
        seed=draw(st.integers(0, 2**64)),
        config={draw(st.text(max_size=4)): draw(st.integers() | st.text(max_size=5) | st.none())},
    )
    at = max(0, draw(st.sampled_from(edges_us)) - draw(st.integers(0, 2000)))
    packets = []
    for _ in range(draw(st.integers(0, 4))):
        steps = draw(st.lists(st.integers(0, 700) | st.integers(0, step_us), max_size=12))
        t = at + np.cumsum(np.array(steps, np.int64))
        at = int(t[-1]) if len(t) else at
        seed = np.random.default_rng(draw(st.integers(0, 2**32)))
        x, y = seed.integers(0, stream.width, len(t)), seed.integers(0, stream.height, len(t))
        packets.append(make_events(t, x, y, seed.integers(0, 2, len(t))))
    return stream, packets
