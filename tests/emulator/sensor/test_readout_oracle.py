"""What holds for the readout with any events and settings: it is the plain one, byte for byte."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.sensor import Readout, ReadoutParameters, ReadoutState, SensorParameters
from evs.msgs import EVENT_DTYPE, Events, empty_events
from reference.readout import as_bytes, as_events, tell

pytestmark = pytest.mark.property

SIDE = 40
BASE = SensorParameters("any", SIDE, SIDE, 0.2, 0.2)

SENSORS = st.builds(
    lambda latency_us, latency_sigma_us, readout: replace(
        BASE, latency_us=latency_us, latency_sigma_us=latency_sigma_us, readout=readout
    ),
    latency_us=st.just(0.0) | st.floats(0.0, 300.0),
    latency_sigma_us=st.just(0.0) | st.floats(0.0, 100.0),
    readout=st.builds(
        ReadoutParameters,
        order=st.sampled_from(["ideal", "arbiter", "scan"]),
        row_ns=st.integers(0, 20_000),
        column_ns=st.integers(0, 5_000),
        jitter_ns=st.just(0.0) | st.floats(0.0, 10_000.0),
        phase_ns=st.just(0) | st.integers(1, 999),
        scan_us=st.integers(20, 900),
        # of 40 columns in the shortest scan
        scan_column_ns=st.just(0) | st.integers(1, 500),
        scan_from=st.sampled_from(["left", "right"]),
        scan_every=st.integers(1, 3),
        scan_events=st.just(0) | st.integers(1, 60),
        erc_rate_mevs=st.just(0.0) | st.floats(0.05, 2.0),
        erc_period_us=st.integers(20, 500),
        erc_drop=st.sampled_from(["time", "row", "column"]),
        bandwidth_mevs=st.just(0.0) | st.floats(0.001, 2.0),
        fifo=st.integers(1, 60),
        stamp=st.sampled_from(["sent", "read"]),
        roi=st.just(()) | st.sampled_from([(3, 4, 20, 30), (0, 0, 20, 40, 10, 10, 30, 1)]),
        mask=st.sampled_from([(), (7, 7), (5, 6, 30, 30, 5, 6)]),
    ),
)


def burst(seed: int, count: int, begin_us: int, end_us: int) -> Events:
    """Random events in (begin_us, end_us], some pixels several times, with causes in byte 13."""
    generator = np.random.default_rng(seed)
    events = empty_events(count)
    busy = generator.integers(0, SIDE, (2, 5))
    for name, line in (("x", busy[0]), ("y", busy[1])):
        events[name] = np.where(
            generator.random(count) < 0.4,
            generator.choice(line, count),
            generator.integers(0, SIDE, count),
        )
    # half of them at few moments, so that many are simultaneous
    moments = generator.integers(begin_us + 1, end_us + 1, 4)
    events["t"] = np.sort(
        np.where(
            generator.random(count) < 0.5,
            generator.choice(moments, count),
            generator.integers(begin_us + 1, end_us + 1, count),
        )
    )
    events["p"] = generator.integers(0, 2, count)
    events.view(np.uint8).reshape(-1, 16)[:, 13] = generator.integers(0, 5, count)
    return events


def cut(events: Events, ends_us: list[int], begin_us: int) -> list[tuple[Events, int, int]]:
    """(events, begin, end) of each tick."""
    ticks = []
    for end_us in ends_us:
        inside = (events["t"] > begin_us) & (events["t"] <= end_us)
        first, last = np.searchsorted(events["t"], [begin_us, end_us], "right")
        assert inside.sum() == last - first
        ticks.append((events[first:last], begin_us, end_us))
        begin_us = end_us
    return ticks


def run(
    sensor: SensorParameters, seed: int, ticks: list[tuple[Events, int, int]]
) -> tuple[bytes, ReadoutState]:
    readout = Readout(sensor)
    state = readout.init(seed)
    parts = []
    came = went = 0
    for events, begin_us, end_us in ticks:
        before = events.tobytes()
        out, state = readout.step(events, state, begin_us, end_us)
        assert events.tobytes() == before
        assert out.dtype == EVENT_DTYPE
        if len(out):
            assert begin_us < out["t"][0]
            assert out["t"][-1] <= end_us
            assert (np.diff(out["t"]) >= 0).all()
        came, went = came + len(events), went + len(out)
        assert came == went + state.count_waiting + sum(state.dropped.values())
        parts.append(out.tobytes())
    return b"".join(parts), state


@pytest.mark.slow
@settings(max_examples=300)
@given(
    sensor=SENSORS,
    seed=st.integers(-(2**63), 2**64),
    begin_us=st.integers(-5000, 5000) | st.integers(-(2**51), 2**51),
    count=st.integers(0, 400),
    inner=st.lists(st.integers(1, 2999), max_size=6),
)
def test_native_is_the_oracle_however_time_is_cut(
    sensor: SensorParameters, seed: int, begin_us: int, count: int, inner: list[int]
) -> None:
    events = burst(seed % 2**32, count, begin_us, begin_us + 2000)
    ends_us = [begin_us + end for end in [*sorted(set(inner)), 3000]]
    raw, state = run(sensor, seed, cut(events, ends_us, begin_us))
    told = tell(sensor, seed, as_events(events), ends_us[-1])
    assert {k: v for k, v in state.dropped.items() if v} == dict(+told.dropped)
    assert state.count_waiting == told.waiting
    assert raw == as_bytes(told)
    # one tick alone leaves the same state behind
    whole, once = run(sensor, seed, cut(events, ends_us[-1:], begin_us))
    assert whole == raw
    assert once == state


@settings(max_examples=60)
@given(sensor=SENSORS, seed=st.integers(0, 2**32), at=st.integers(0, 9))
def test_a_saved_state_goes_on_with_the_same_bytes(
    sensor: SensorParameters, seed: int, at: int
) -> None:
    ticks = cut(burst(seed, 600, 0, 2000), [200 * (k + 1) for k in range(14)], 0)
    whole, end = run(sensor, seed, ticks)
    readout = Readout(sensor)
    state = readout.init(seed)
    parts = []
    for k, (events, begin_us, end_us) in enumerate(ticks):
        if k == at:
            file = io.BytesIO()
            np.savez(file, **state.save())
            file.seek(0)
            with np.load(file) as saved:
                state = ReadoutState.restore(saved)
            readout = Readout(sensor)
        out, state = readout.step(events, state, begin_us, end_us)
        parts.append(out.tobytes())
    assert b"".join(parts) == whole
    assert state == end


def test_the_arbiter_finds_the_next_of_many_rows() -> None:
    # rows are found in words of 64 and in groups of 64 words: the tallest sensor has two groups
    high = 8192
    readout = ReadoutParameters(order="arbiter", row_ns=8_000, column_ns=100, phase_ns=999)
    sensor = replace(BASE, width=4, height=high, readout=readout)
    edges = [0, 63, 64, 4031, 4032, 4095, 4096, 8127, 8128, high - 1]
    generator = np.random.default_rng(3)
    events = empty_events(400)
    # one row at a time at first, then many that wait
    events["t"] = np.sort(np.append(np.arange(1, 101) * 20, generator.integers(2001, 4000, 300)))
    rows = np.append(generator.choice(edges, 200), generator.integers(0, high, 200))
    events["y"] = generator.permutation(rows)
    events["x"] = generator.integers(0, 4, 400)
    raw, state = run(sensor, 5, cut(events, [1000, 2500, 6000], 0))
    told = tell(sensor, 5, as_events(events), 6000)
    assert raw == as_bytes(told)
    assert state.count_waiting == told.waiting == 0
