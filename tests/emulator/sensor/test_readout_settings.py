"""The readout's settings, its state, what it refuses, and where its limits are."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.config import ReadoutConfig, SensorConfig
from evs.emulator.sensor import (
    Readout,
    ReadoutParameters,
    ReadoutState,
    make_readout,
    resolve_sensor,
)
from evs.msgs import Events, EvsError, empty_events, make_events
from reference.readout import sensor_of


def test_an_ideal_readout_is_not_there() -> None:
    assert make_readout(sensor_of()) is None
    assert make_readout(sensor_of(row_ns=5, scan_us=7, fifo=3, erc_drop="row")) is None
    assert resolve_sensor(SensorConfig("ideal")).readout.is_ideal
    for part in (
        {"order": "scan"},
        {"order": "arbiter"},
        {"erc_rate_mevs": 1.0},
        {"bandwidth_mevs": 1.0},
        {"roi": (0, 0, 1, 1)},
        {"mask": (0, 0)},
        {"mask_file": "x"},
        {"latency_us": 1.0},
        {"latency_sigma_us": 1.0},
    ):
        if "mask_file" not in part:
            assert isinstance(make_readout(sensor_of(**part)), Readout)
        else:
            assert not sensor_of(**part).readout.is_ideal


def test_a_mask_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "hot.txt"
    path.write_text("# hot pixels\n3 4\n\n5,6   # another\n")
    rows = [(1, 3, 4, 1), (1, 5, 6, 0), (1, 6, 5, 0)]
    readout = Readout(sensor_of(mask_file=str(path)))
    out, state = readout.step(make_events(*zip(*rows, strict=True)), readout.init(0), 0, 10)
    assert out.tolist() == [(1, 6, 5, 0)]
    assert state.dropped["mask"] == 2
    for text, said in (
        ("3 4 5\n", "line 1: give x y of a pixel"),
        ("1 1\n-1 2\n", "line 2: give x y of a pixel"),
        ("1 1\n64 0\n", "line 2: pixel 64 0 is not on the 64 x 48 sensor"),
    ):
        path.write_text(text)
        with pytest.raises(EvsError, match=said):
            Readout(sensor_of(mask_file=str(path)))
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(EvsError, match="is not text"):
        Readout(sensor_of(mask_file=str(path)))
    with pytest.raises(EvsError, match="no mask file"):
        Readout(sensor_of(mask_file=str(tmp_path / "none.txt")))
    with pytest.raises(EvsError, match="cannot read mask file"):
        Readout(sensor_of(mask_file=str(tmp_path)))


def test_a_region_or_a_pixel_off_the_sensor_is_refused() -> None:
    for roi in ((0, 0, 65, 1), (60, 0, 5, 1), (0, 47, 1, 2), (-1, 0, 2, 2), (0, 0, 0, 1)):
        with pytest.raises(EvsError, match=r"roi .* does not lie on the 64 x 48 sensor"):
            Readout(sensor_of(roi=roi))
    with pytest.raises(EvsError, match="pixel 0 48 is not on the 64 x 48 sensor"):
        Readout(sensor_of(mask=(0, 48)))


def test_a_state_is_a_value() -> None:
    sensor = sensor_of(order="arbiter", row_ns=1000, latency_us=3.0, bandwidth_mevs=0.1)
    readout = Readout(sensor)
    events = make_events(range(1, 41), range(40), range(40), [1] * 40)
    _, state = readout.step(events, readout.init(-1), 0, 40)
    kept = state.copy()
    assert kept == state == ReadoutState.restore(state.save())
    assert kept.count_waiting > 10
    readout.step(empty_events(), state, 40, 60)
    assert kept != state
    assert kept != "state"
    assert readout.init(-1) == readout.init(2**64 - 1) != readout.init(0)


def test_damaged_states_are_refused() -> None:
    readout = Readout(sensor_of(order="arbiter", row_ns=1000))
    events = make_events([1, 2], [3, 4], [5, 6], [1, 0])
    _, state = readout.step(events, readout.init(0), 0, 2)
    saved = state.save()
    with pytest.raises(EvsError, match="lacks 'due_ns'"):
        ReadoutState.restore({k: v for k, v in saved.items() if k != "due_ns"})
    for name, value in (
        ("clock", saved["clock"][:-1]),
        ("due_ns", saved["due_ns"][:-1]),
        ("waiting", saved["waiting"][:-1]),
        ("clock", saved["clock"] + 1),
    ):
        with pytest.raises(EvsError, match="is damaged"):
            ReadoutState.restore(saved | {name: value})
    # fits, but not this sensor
    saved["waiting"].view(np.int16)[5] = 400
    with pytest.raises(EvsError, match="not on the sensor"):
        readout.step(empty_events(), ReadoutState.restore(saved), 2, 4)


def test_bad_steps_are_refused_and_change_nothing() -> None:
    readout = Readout(sensor_of(bandwidth_mevs=0.01))
    state = readout.init(0)
    good = make_events([5, 6], [1, 2], [3, 4], [1, 0])

    def refused(events: Events, begin_us: int, end_us: int, said: str) -> None:
        before = state.copy()
        with pytest.raises(EvsError, match=said):
            readout.step(events, state, begin_us, end_us)
        assert state == before

    refused(good, 10, 10, "does not go forward")
    refused(good, 5, 10, "not sorted or before the tick")
    refused(good, 0, 5, "after the tick")
    refused(good[::-1], 0, 10, "not sorted")
    refused(make_events([5], [64], [0], [1]), 0, 10, "not on the sensor")
    refused(make_events([5], [0], [-1], [1]), 0, 10, "not on the sensor")
    refused(empty_events(), 0, 2**52 + 1, "beyond")
    refused(empty_events(), -(2**60), 0, "beyond")
    _, state = readout.step(good, state, 0, 10)
    refused(empty_events(), 11, 20, "does not follow the last, which ended at 10 us")


def test_columns_that_take_longer_than_their_scan() -> None:
    sensor_of(order="scan", scan_us=200, scan_column_ns=3125)
    sensor_of(order="arbiter", scan_us=200, scan_column_ns=3126)
    with pytest.raises(EvsError, match=r"64 columns take longer than .* 200 us; give at most 3125"):
        sensor_of(order="scan", scan_us=200, scan_column_ns=3126)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"order": "rolling"}, r"no order of readout \(sensor.readout.order\) 'rolling'; there is"),
        ({"erc_drop": "rows"}, "there is: row"),
        ({"stamp": "red"}, "there is: read"),
        ({"row_ns": -1}, "sensor.readout.row_ns is -1; give 0 ... 1000000000"),
        ({"column_ns": 1.5}, "sensor.readout.column_ns is 1.5; give a whole number"),
        ({"fifo": 0}, "sensor.readout.fifo is 0; give 1"),
        ({"fifo": True}, "sensor.readout.fifo is True"),
        ({"scan_us": 0}, "sensor.readout.scan_us is 0"),
        (
            {"scan_from": "top"},
            r"no side \(sensor.readout.scan_from\) 'top'; there is: left, right",
        ),
        ({"scan_every": 0}, "sensor.readout.scan_every is 0"),
        ({"jitter_ns": math.nan}, "sensor.readout.jitter_ns is nan"),
        ({"jitter_ns": "1"}, "sensor.readout.jitter_ns is '1'; give a number"),
        ({"bandwidth_mevs": -1.0}, "sensor.readout.bandwidth_mevs is -1"),
        ({"bandwidth_mevs": math.inf}, "sensor.readout.bandwidth_mevs is inf"),
        ({"bandwidth_mevs": 1e-9}, "give 0 .unlimited. or 1e-06"),
        ({"erc_rate_mevs": 0.001}, "not one event each 200 us"),
        ({"erc_period_us": 0}, "sensor.readout.erc_period_us is 0"),
        ({"roi": (1, 2, 3)}, "sensor.readout.roi has 3 numbers; give x y width height"),
        ({"mask": (1,)}, "sensor.readout.mask has 1 numbers; give x y, and again"),
        ({"mask": (1, 2.0)}, "sensor.readout.mask is .1, 2.0.; give whole numbers"),
        ({"roi": 4}, "sensor.readout.roi is 4; give whole numbers"),
        ({"mask_file": 4}, "sensor.readout.mask_file is 4; give a file"),
    ],
)
def test_senseless_values(keys: dict[str, object], said: str) -> None:
    with pytest.raises(EvsError, match=said) as error:
        ReadoutParameters(**keys)  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


def test_senseless_latencies() -> None:
    for keys in ({"latency_us": -1.0}, {"latency_sigma_us": math.nan}, {"latency_us": 1e7}):
        with pytest.raises(EvsError, match=r"sensor\.latency_"):
            sensor_of(**keys)


def test_a_readout_from_a_sensor_file_and_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "hot.txt").write_text("1 2\n")
    path = tmp_path / "chip.toml"
    path.write_text(
        "width = 20\nheight = 10\npos_thres = 0.3\nneg_thres = 0.4\nlatency_us = 20\n"
        '[readout]\norder = "arbiter"\nrow_ns = 500\nroi = [1, 2, 3, 4]\nmask_file = "hot.txt"\n'
    )
    config = SensorConfig(str(path), readout=ReadoutConfig(row_ns=600, bandwidth_mevs=12.0))
    sensor = resolve_sensor(config)
    assert sensor.latency_us == 20
    assert sensor.readout == ReadoutParameters(
        order="arbiter",
        row_ns=600,
        bandwidth_mevs=12.0,
        roi=(1, 2, 3, 4),
        mask_file=str(tmp_path / "hot.txt"),
    )
    path.write_text(path.read_text().replace("order", "ordre"))
    with pytest.raises(
        EvsError, match=r"no key of sensor file .* 'readout.ordre'; there is: readout"
    ):
        resolve_sensor(config)


def test_targets_are_whole_in_decimal() -> None:
    assert ReadoutParameters(erc_rate_mevs=0.29, erc_period_us=100).erc_target == 29
    assert ReadoutParameters(erc_rate_mevs=20.0).erc_target == 4000
    assert ReadoutParameters(bandwidth_mevs=0.1).link_rate == 100_000


@pytest.mark.parametrize(
    "keys",
    [
        {"roi": (0, 0, 60, 40)},
        {"order": "arbiter", "row_ns": 2, "column_ns": 1},
        {"order": "scan"},
        {"erc_rate_mevs": 100.0},
        {"bandwidth_mevs": 165.0, "latency_us": 10.0, "latency_sigma_us": 5.0},
    ],
    ids=lambda keys: "-".join(keys),
)
def test_a_million_events_in_a_tick_take_no_seconds(keys: dict[str, object]) -> None:
    count = 1_000_000
    t = np.arange(count) // 1000 + 1
    events = make_events(t, np.arange(count) % 64, np.arange(count) // 64 % 48, 1)
    readout = Readout(sensor_of(**keys))
    state = readout.init(0)
    start_s = time.process_time()
    out, state = readout.step(events, state, 0, 1000)
    assert time.process_time() - start_s < 1.0
    assert len(out) + state.count_waiting + sum(state.dropped.values()) == count


def test_it_works_at_the_edges_of_time_and_of_its_settings() -> None:
    sensor = sensor_of(
        latency_us=1e6,
        latency_sigma_us=1e6,
        order="arbiter",
        row_ns=10**9,
        column_ns=10**9,
        jitter_ns=1e9,
        bandwidth_mevs=1e-6,
        fifo=2**31,
        erc_rate_mevs=8000.0,
        erc_period_us=10**6,
    )
    for begin_us in (-(2**52), 2**52 - 3000):
        readout = Readout(sensor)
        t = begin_us + np.arange(1, 2001)
        state = readout.init(0)
        out, state = readout.step(
            make_events(t, t % 64, t % 48, 1), state, begin_us, begin_us + 2500
        )
        went = len(out)
        if begin_us < 0:
            # the arbiter takes seconds an event, the link one second
            for k in range(40):
                base_us = begin_us + 2500 + k * 10**6
                out, state = readout.step(empty_events(), state, base_us, base_us + 10**6)
                assert ((out["t"] > base_us) & (out["t"] <= base_us + 10**6)).all()
                assert len(out) <= 1
                went += len(out)
            assert went > 2
        assert went + state.count_waiting + sum(state.dropped.values()) == 2000
