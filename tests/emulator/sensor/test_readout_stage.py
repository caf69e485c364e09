"""The readout by hand: each part of it on events whose fate is plain to see."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from evs.emulator.config import ReadoutConfig, SensorConfig
from evs.emulator.sensor import Readout, ReadoutState, SensorParameters, resolve_sensor
from evs.msgs import clean_events, empty_events, make_events
from reference.readout import sensor_of

Rows = list[tuple[int, int, int, int]]


def run(
    sensor: SensorParameters, rows: Rows, *ends_us: int, seed: int = 0
) -> tuple[list[Rows], ReadoutState]:
    """(t, x, y, p) that come out of each tick; ticks begin at 0."""
    readout, begin_us, found = Readout(sensor), 0, []
    state = readout.init(seed)
    for end_us in ends_us:
        inside = [row for row in rows if begin_us < row[0] <= end_us]
        events = make_events(*zip(*inside, strict=True)) if inside else empty_events()
        out, state = readout.step(events, state, begin_us, end_us)
        found.append(out.tolist())
        begin_us = end_us
    return found, state


def test_region_and_mask() -> None:
    rows = [(1, x, y, 1) for y in range(48) for x in range(64)]
    sensor = sensor_of(roi=(10, 5, 4, 3, 60, 40, 4, 8), mask=(11, 6, 0, 0, 63, 47))
    (out,), state = run(sensor, rows, 1000)
    inside = {(x, y) for x in range(10, 14) for y in range(5, 8)}
    inside |= {(x, y) for x in range(60, 64) for y in range(40, 48)}
    assert {row[1:3] for row in out} == inside - {(11, 6), (63, 47)}
    # a masked pixel outside the region is outside the region
    assert state.dropped == {
        "roi": 64 * 48 - 44, "mask": 2, "busy": 0, "scan": 0, "erc": 0, "fifo": 0,
    }  # fmt: skip


def test_latency_moves_events_into_the_tick_they_belong_to() -> None:
    rows = [(990, 1, 1, 1), (1000, 2, 2, 0), (1001, 3, 3, 1)]
    found, state = run(sensor_of(latency_us=10.5), rows, 1000, 1010, 1011, 1012)
    # 1000.5, 1010.5 and 1011.5 us, rounded up
    assert found == [[], [(1001, 1, 1, 1)], [(1011, 2, 2, 0)], [(1012, 3, 3, 1)]]
    assert state.count_waiting == 0


@pytest.mark.statistical
def test_latency_has_its_mean_and_spread_and_follows_seed_pixel_time_polarity() -> None:
    count = 40_000
    t = np.sort(np.random.default_rng(1).integers(1, 10**6, count))
    x, y = np.arange(count) % 64, np.arange(count) // 64 % 48

    def late(seed: int, p: int, shift: int = 0) -> np.ndarray:
        readout = Readout(sensor_of(latency_us=200.0, latency_sigma_us=20.0))
        events = make_events(t, (x + shift) % 64, y, np.full(count, p))
        out, state = readout.step(events, readout.init(seed), 0, 1_001_000)
        assert state.count_waiting == 0
        # every event once: by pixel and order, which overtaking within a pixel does not change
        order = np.lexsort((out["t"], (out["x"] - shift) % 64, out["y"]))
        began = np.lexsort((t, x, y))
        late_us = np.zeros(count)
        late_us[began] = out["t"][order] - t[began]
        return late_us

    one = late(1, 1)
    # rounding up adds half a us; a few of 40,000 exchange places, which leaves the mean
    assert abs(one.mean() - 200.5) < 5 * 20.0 / math.sqrt(count)
    assert abs(one.std() / 20.0 - 1.0) < 5 / math.sqrt(2 * count) + 0.005
    assert np.array_equal(one, late(1 + 2**64, 1))
    for other in (late(2, 1), late(1, 0), late(1, 1, shift=1)):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5 / math.sqrt(count)


def test_no_latency_is_below_zero() -> None:
    rows = [(t, t % 64, t % 48, 1) for t in range(1, 1001)]
    found, state = run(sensor_of(latency_us=1.0, latency_sigma_us=50.0), rows, 1000, 2000)
    out = found[0] + found[1]
    assert len(out) == 1000
    assert state.count_waiting == 0
    began = {(row[1], row[2]): row[0] for row in rows if row[0] <= 64}
    late = [row[0] - began[row[1:3]] for row in out if row[0] < 60 and row[1:3] in began]
    assert min(late) == 0


def test_the_arbiter_serves_row_after_row() -> None:
    rows = [(1, 9, 5, 1), (1, 3, 5, 0), (1, 7, 2, 1), (2, 8, 5, 1), (4, 0, 0, 1)]
    sensor = sensor_of(order="arbiter", row_ns=1500, column_ns=1000)
    # row 2: 1.0 us, latched at 2.5 and sent by 3.5; row 5 latched at 5.0 with what came meanwhile
    # and sent by 8.0, from the right as this seed draws; row 0 latched at 9.5
    (out,), _ = run(sensor, rows, 1000)
    assert out == [(3, 7, 2, 1), (5, 9, 5, 1), (5, 8, 5, 1), (5, 3, 5, 0), (10, 0, 0, 1)]
    # the same in ticks of a us
    found, state = run(sensor, rows, *range(1, 12))
    assert [row for rows in found for row in rows] == out
    assert state.count_waiting == 0


@pytest.mark.statistical
def test_rows_share_stamps_as_in_recordings_of_a_davis346() -> None:
    # A recording of a static scene (davis346.aedat4 of faery 0.7.1, without the ON events at the
    # reads of APS rows): rate .0324 ev/us as pixels meet it, and 1330 of 74332 successive events
    # have the same stamp and another row. Poisson events whose readout takes d us share a us in
    # rate / 2 (1 - d^2) of the cases.
    count, per_us = 60_000, 0.0324
    generator = np.random.default_rng(5)
    t = np.sort(generator.integers(1, round(count / per_us), count))
    x, y = generator.integers(0, 346, count), generator.integers(130, 240, count)

    def share(**readout: Any) -> tuple[float, float]:
        sensor = resolve_sensor(SensorConfig("davis346", readout=ReadoutConfig(**readout)))
        stage = Readout(sensor)
        out, _ = stage.step(make_events(t, x, y, t % 2), stage.init(1), 0, int(t[-1]) + 100)
        same = np.diff(out["t"]) == 0
        columns = np.diff(out["x"])[same & (np.diff(out["y"]) == 0)]
        return float((same & (np.diff(out["y"]) != 0)).mean()), float((columns > 0).mean())

    other_row, rising = share()
    expected = per_us / 2 * (1 - 0.183**2)
    assert abs(other_row - expected) < 4 * math.sqrt(expected / count)
    # the recording is bursty, which adds a tenth
    assert 0.75 < other_row / (1330 / 74332) < 1.1
    # x rises in 48 of 114 pairs of the recording's row accesses: columns have no fixed order
    assert 0.2 < rising < 0.8
    # with requests at the ends of their us, and half a us for each row, only crowds share one
    assert share(phase_ns=0, row_ns=500)[0] < 0.001


def test_a_pixel_that_waits_for_the_arbiter_is_blind() -> None:
    rows = [(1, 3, 3, 1), (2, 3, 3, 0), (3, 3, 3, 0), (5, 3, 3, 1)]
    (out,), state = run(sensor_of(order="arbiter", row_ns=2000), rows, 100)
    # latched at 3.0 us; that of 5 us asks anew
    assert out == [(3, 3, 3, 1), (7, 3, 3, 1)]
    assert state.dropped["busy"] == 2


def test_the_arbiter_starves_no_row() -> None:
    # two rows ask without end, the third only once
    rows = sorted((t, x, y, 1) for t in range(1, 400) for x in range(4) for y in (10, 11))
    rows.append((400, 0, 40, 1))
    (out,), _ = run(sensor_of(order="arbiter", row_ns=400, column_ns=300), sorted(rows), 500)
    last = next(row for row in out if row[2] == 40)
    assert last[0] <= 400 + 2 * 2 + 2  # two accesses of 4 columns, 1.6 us each, and its own


def test_jitter_of_the_arbiter_has_its_spread_and_follows_the_seed() -> None:
    rows = [(20 * k, k % 64, k % 48, 1) for k in range(1, 2001)]
    sensor = sensor_of(order="arbiter", row_ns=9500, jitter_ns=1000.0)
    stamps = [np.array([row[0] for row in run(sensor, rows, 41_000, seed=s)[0][0]]) for s in (0, 1)]
    late = stamps[0] - np.array([row[0] for row in rows])
    # the mean of 9.5 us rounded up is 10 us; sigma of a rounded normal is sqrt(1 + 1 / 12) us
    sigma = math.sqrt(1 + 1 / 12)
    assert abs(late.mean() - 10.0) < 5 * sigma / math.sqrt(len(late))
    assert abs(late.std() / sigma - 1) < 5 / math.sqrt(2 * len(late))
    assert (stamps[0] != stamps[1]).any()


def test_jitter_of_states_that_share_a_readout_follows_each_ones_seed_and_count() -> None:
    # row times are drawn many at a time: those of another state must not be taken for them
    sensor = sensor_of(order="arbiter", row_ns=900, column_ns=50, jitter_ns=300.0)
    rows = [(t, t % 64, t % 48, 1) for t in range(1, 1001)]
    ends_us = range(10, 1001, 10)
    alone = [run(sensor, rows, *ends_us, seed=seed)[0] for seed in (1, 2)]
    shared = Readout(sensor)
    found: list[list[Rows]] = [[], []]
    states = [shared.init(seed) for seed in (1, 2)]
    for end_us in ends_us:
        events = make_events(*zip(*rows[end_us - 10 : end_us], strict=True))
        for place, state in enumerate(states):
            # the second is also stepped again from where it was
            for again in (state.copy(), state)[1 - place :]:
                out, states[place] = shared.step(events, again, end_us - 10, end_us)
            found[place].append(out.tolist())
    assert found == alone


def test_the_scan_gives_one_event_a_pixel_at_its_multiples() -> None:
    rows = [(199, 5, 5, 1), (199, 6, 2, 0), (200, 5, 5, 0), (201, 5, 5, 0), (950, 1, 1, 1)]
    found, state = run(sensor_of(order="scan", scan_us=200), rows, 300, 1000)
    # (5, 5)'s first event counts; row 2 comes before row 5
    assert found == [[(200, 6, 2, 0), (200, 5, 5, 1)], [(400, 5, 5, 0), (1000, 1, 1, 1)]]
    assert state.dropped["scan"] == 1


def test_scan_stamps_of_a_storm_are_multiples_also_before_time_zero() -> None:
    generator = np.random.default_rng(3)
    t = np.sort(generator.integers(-4999, 5001, 50_000))
    events = make_events(
        t, generator.integers(0, 64, 50_000), generator.integers(0, 48, 50_000), t % 2
    )
    readout = Readout(sensor_of(order="scan", scan_us=130))
    out, state = readout.step(events, readout.init(0), -5000, 5000)
    assert (out["t"] % 130 == 0).all()
    places = np.stack([out["t"], out["y"], out["x"]])
    # in order, and each pixel once a scan
    assert (np.diff(np.ravel_multi_index(places + [[5000], [0], [0]], (10_001, 48, 64))) > 0).all()
    assert len(out) + state.dropped["scan"] + state.count_waiting == 50_000


def test_a_scan_reads_its_columns_one_after_another_from_either_side() -> None:
    rows = [(199, 5, 5, 1), (199, 63, 7, 1), (199, 63, 2, 0), (200, 0, 0, 1), (201, 63, 7, 0)]
    (rising,), _ = run(sensor_of(order="scan", scan_us=200, scan_column_ns=3000), rows, 1000)
    # column x is read 3 (x + 1) us after its scan begins; rows of a column stay in order
    assert rising == [
        (203, 0, 0, 1), (218, 5, 5, 1), (392, 63, 2, 0), (392, 63, 7, 1), (592, 63, 7, 0),
    ]  # fmt: skip
    falling, state = run(
        sensor_of(order="scan", scan_us=200, scan_column_ns=3000, scan_from="right"),
        rows, 203, 375, 376, 392, 1000,
    )  # fmt: skip
    # ticks may end between two columns of a scan
    assert falling == [
        [(203, 63, 2, 0), (203, 63, 7, 1)], [], [], [(377, 5, 5, 1), (392, 0, 0, 1)],
        [(403, 63, 7, 0)],
    ]  # fmt: skip
    assert state.dropped["scan"] == 0


def test_an_event_during_a_scan_waits_for_the_next_although_its_column_is_still_to_be_read() -> (
    None
):
    rows = [(200, 60, 0, 1), (201, 60, 0, 0), (390, 60, 0, 1), (399, 60, 1, 1)]
    (out,), state = run(sensor_of(order="scan", scan_us=200, scan_column_ns=3000), rows, 1000)
    assert out == [(383, 60, 0, 1), (583, 60, 0, 0), (583, 60, 1, 1)]
    assert state.dropped["scan"] == 1


def test_a_scan_with_many_events_skips_the_next_ones() -> None:
    # 25 events in the first scan, one each 10 us from then on
    rows = [(100, x, 0, 1) for x in range(25)] + [
        (t, t // 10 % 64, 1, 1) for t in range(101, 900, 10)
    ]
    sensor = sensor_of(order="scan", scan_us=100, scan_events=10, scan_every=1)
    (out,), state = run(sensor, rows, 900)
    stamps, counts = np.unique([row[0] for row in out], return_counts=True)
    # 25 events take three scans, the 30 that come meanwhile three more, then it is the 900
    assert dict(zip(stamps.tolist(), counts.tolist(), strict=True)) == {100: 25, 400: 30, 700: 30}
    assert state.count_waiting == 20
    every = sensor_of(order="scan", scan_us=100, scan_every=4)
    (out,), _ = run(every, rows, 900)
    assert {row[0] for row in out} == {400, 800}


def test_a_dvxplorer_stamps_as_recordings_of_it_do() -> None:
    sensor = resolve_sensor(SensorConfig("dvxplorer"))
    generator = np.random.default_rng(11)
    count = 300_000  # 3 Mev/s of 4000 pixels
    t = np.sort(generator.integers(1, 100_001, count))
    x, y = generator.integers(0, 640, 4000), generator.integers(0, 480, 4000)
    pixel = generator.integers(0, 4000, count)
    readout = Readout(sensor)
    out, _ = readout.step(make_events(t, x[pixel], y[pixel], t % 2), readout.init(0), 0, 101_000)
    # of about 590 events a scan, one step of x is upwards: from a scan to the next
    falls = np.diff(out["x"]) <= 0
    assert falls.mean() > 0.99
    phase = (out["t"] - 1) % 196
    # columns take 192 us, the detection of events the rest
    assert phase.max() == 191
    assert np.bincount(phase, minlength=192).min() > 0
    # intervals of a pixel are multiples of the scan
    order = np.lexsort((out["t"], out["x"], out["y"]))
    place = out["y"][order] * 640 + out["x"][order]
    intervals = np.diff(out["t"][order])[np.diff(place) == 0]
    assert (intervals % 196 == 0).all()
    assert intervals.min() == 196
    assert len(np.unique(out["t"])) > 50_000
    # pixels that are blind for two scans have no interval under two, but odd multiples
    t = np.cumsum(generator.integers(400, 1500, 200))
    out, _ = readout.step(make_events(t, [7] * 200, [9] * 200, t % 2), readout.init(0), 0, 400_000)
    scans = np.diff(out["t"]) // 196
    assert set(scans.tolist()) == {2, 3, 4, 5, 6, 7, 8}


@pytest.mark.parametrize("drop", ["time", "row", "column"])
def test_rate_control_lets_no_more_than_its_target_through(drop: str) -> None:
    generator = np.random.default_rng(5)
    sensor = sensor_of(erc_rate_mevs=1.5, erc_period_us=100, erc_drop=drop)
    t = np.sort(generator.integers(1, 20_001, 100_000))  # 5 Mev/s
    events = make_events(t, generator.integers(0, 64, len(t)), generator.integers(0, 48, len(t)), 1)
    readout = Readout(sensor)
    out, state = readout.step(events, readout.init(0), 0, 20_000)
    periods = np.bincount((out["t"] - 1) // 100, minlength=200)
    assert periods.max() <= 150
    # and little less: whole lines are 1 of 32, and what comes varies by sqrt(500)
    assert periods[1:].mean() > {"time": 140, "row": 125, "column": 125}[drop]
    assert len(out) + state.dropped["erc"] == len(t)
    if drop == "time":
        # evenly over the period: the last tenth of it is not empty
        assert ((out["t"][out["t"] > 100] - 1) % 100 >= 90).mean() > 0.05
    else:
        lines = np.unique((out["y"] if drop == "row" else out["x"])[out["t"] > 100])
        assert len(lines) < {"row": 48, "column": 64}[drop]


def test_rate_control_leaves_a_quiet_stream_alone() -> None:
    rows = [(t, t % 64, t % 48, 1) for t in range(1, 2001)]  # 1 Mev/s
    (out,), state = run(sensor_of(erc_rate_mevs=1.0, erc_period_us=200), rows, 2000)
    assert out == rows
    assert sum(state.dropped.values()) == 0


def test_the_link_delays_and_its_fifo_is_bounded() -> None:
    rows = [(10, x, y, 1) for y in range(2) for x in range(50)]
    sensor = sensor_of(bandwidth_mevs=0.5, fifo=20)
    # one leaves at once, twenty wait 2 us more each
    found, state = run(sensor, rows, 30, 1000)
    assert [row[0] for row in found[0]] == list(range(10, 31, 2))
    assert [row[0] for row in found[1]] == list(range(32, 51, 2))
    assert state.dropped["fifo"] == 79
    assert state.count_waiting == 0


def test_a_link_that_is_busy_for_seconds_keeps_its_rate() -> None:
    rows = [(10, x, 0, 1) for x in range(10)]
    (out,), _ = run(sensor_of(bandwidth_mevs=3e-6), rows, 4_000_000)
    assert [row[0] for row in out] == [10 + -(-k * 10**6 // 3) for k in range(10)]


def test_a_link_may_stamp_before_it_waits() -> None:
    rows = [(10, x, 0, 1) for x in range(50)] + [(30, 0, 1, 0)]
    sensor = sensor_of(bandwidth_mevs=0.5, fifo=20, stamp="read")
    (out,), state = run(sensor, rows, 1000)
    # at 30 us ten have left after the first, so there is a place again
    assert [row[0] for row in out] == [10] * 21 + [30]
    assert state.dropped["fifo"] == 29


def test_no_window_of_the_link_has_more_than_its_rate() -> None:
    generator = np.random.default_rng(7)
    t = np.sort(generator.integers(1, 50_001, 60_000))
    events = make_events(t, t % 64, t % 48, 1)
    readout = Readout(sensor_of(bandwidth_mevs=0.37, fifo=3000))
    state, parts, longest = readout.init(0), [], 0
    for k in range(60):
        inside = events[(t > 1000 * k) & (t <= 1000 * (k + 1))]
        out, state = readout.step(inside, state, 1000 * k, 1000 * (k + 1))
        longest = max(longest, state.count_waiting)
        parts.append(out["t"])
    out = np.concatenate(parts)
    assert longest == 3000
    assert state.dropped["fifo"] > 0
    for window in (1, 10, 1000):
        ends = np.searchsorted(out, out + window)
        assert (ends - np.arange(len(out))).max() <= math.ceil(0.37 * window) + 1


def test_causes_travel_with_their_events() -> None:
    events = make_events([1, 1, 2, 3], [1, 1, 2, 3], [9, 9, 9, 3], [1, 0, 0, 1])
    events.view(np.uint8).reshape(-1, 16)[:, 13] = [1, 2, 3, 4]
    sensor = sensor_of(
        latency_us=5.0, order="arbiter", row_ns=700, column_ns=100, bandwidth_mevs=0.01
    )
    readout = Readout(sensor)
    out, state = readout.step(events, readout.init(0), 0, 5)
    assert len(out) == 0
    out, state = readout.step(empty_events(), ReadoutState.restore(state.save()), 5, 1000)
    causes = out.view(np.uint8).reshape(-1, 16)[:, 13]
    assert sorted(zip(out["x"].tolist(), causes.tolist(), strict=True)) == [(1, 1), (2, 3), (3, 4)]
    assert state.dropped["busy"] == 1
    assert not clean_events(out).view(np.uint8).reshape(-1, 16)[:, 13:].any()


def test_events_in_another_layout() -> None:
    events = make_events(range(1, 9), range(8), range(8), [1] * 8)
    readout = Readout(sensor_of(order="scan"))
    out, _ = readout.step(events[::2], readout.init(0), 0, 200)
    assert out["x"].tolist() == [0, 2, 4, 6]
    packed = np.zeros(8, [("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "i1")])
    for name in ("t", "x", "y", "p"):
        packed[name] = events[name]
    out, _ = readout.step(packed, readout.init(0), 0, 200)
    assert len(out) == 8
