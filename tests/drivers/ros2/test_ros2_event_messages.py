"""Whatever packets come, at whatever thresholds: messages hold every event once, in order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.ros2.event_messages import EventMessageBuilder
from evs.msgs import EventPacket, make_events
from evs.msgs.codecs import PAYLOADS, PayloadReader

pytestmark = pytest.mark.property

COUNTS = st.lists(st.integers(0, 40), min_size=1, max_size=12)
TICKS = st.sampled_from([1, 200, 1000, 7001])
STARTS = st.sampled_from([0, 2**24 - 5000, 2**31 - 3000, 2**32 - 3000, 2**34])
THRESHOLDS_S = st.floats(0, 0.05)
SIZES = st.integers(1, 500)


@pytest.mark.parametrize("encoding", PAYLOADS)
@given(counts=COUNTS, tick_us=TICKS, start_us=STARTS, threshold_s=THRESHOLDS_S, size=SIZES)
def test_messages_hold_every_event_once(
    encoding: str, counts: list[int], tick_us: int, start_us: int, threshold_s: float, size: int
) -> None:
    random = np.random.default_rng([tick_us, len(counts)])
    builder, reader = EventMessageBuilder(encoding, threshold_s, size), PayloadReader(encoding)
    truth, found = [], []
    for seq, count in enumerate(counts):
        begin = start_us + tick_us * seq
        t = np.sort(random.integers(begin + 1, begin + tick_us + 1, count))
        x, y, p = (random.integers(0, side, count) for side in (2048, 2048, 2))
        events = make_events(t, x, y, p)
        truth.append(events)
        packet = EventPacket(seq, begin, begin + tick_us, 2048, 2048, events)
        for message in builder.add(packet):
            found.append((message, packet.time_end_us))
    found += [(message, start_us + tick_us * len(counts)) for message in builder.rest()]
    decoded = []
    for message, now_us in found:
        events = reader.events(message.data, message.time_base_ns)
        assert (message.first_us, message.last_us) == (events["t"][0], events["t"][-1])
        assert message.events == len(events) > 0
        assert message.last_us <= now_us
        decoded.append(events)
    whole = np.concatenate(truth)
    assert np.array_equal(np.concatenate([whole[:0], *decoded]), whole)
    # none but the last is shorter and smaller than was asked for
    for message, now_us in found[:-1]:
        begin_us = start_us + (message.first_us - 1 - start_us) // tick_us * tick_us
        is_long = now_us - begin_us >= round(1e6 * threshold_s)
        assert is_long or len(message.data) >= size
