"""Reads of a frame's rows lift the signal of event pixels: when, and in ticks of any length."""

from __future__ import annotations

import io
import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.config import ApsConfig, SensorConfig
from evs.emulator.sensor import ApsParameters, PlainModel, SensorParameters, resolve_sensor
from evs.emulator.sensor.aps_crosstalk import RowReads
from evs.emulator.sensor.pixel import PlainState
from evs.msgs import EVENT_DTYPE, Cause, Events
from reference.pixel.model import ReferenceModel, caught_up

ROWS, COLUMNS = 8, 70
APS = ApsParameters(enabled=True, rate_hz=100.0, exposure_us=2000, row_us=35.5, crosstalk=0.01)
LEAKY = SensorParameters(
    "leaky", COLUMNS, ROWS, 0.2, 0.2, 0.02, leak_rate_hz=2.0, noise_rate_cov_decades=0.1, aps=APS
)
GREY: F32 = np.full((ROWS, COLUMNS), 0.5, np.float32)


def reads_us(aps: ApsParameters, row: int, frames: range) -> list[int]:
    """When a row is read in so many frames, us: before each exposure and after it."""
    found = []
    for number in frames:
        begin_us = math.floor(number * 1e6 / aps.rate_hz + 0.5)
        if aps.shutter == "global":
            found.append(begin_us - round((ROWS - row) * aps.row_us))
            found.append(begin_us + aps.exposure_us + round((row + 1) * aps.row_us))
        else:
            found.append(begin_us + round(row * aps.row_us))
            found.append(begin_us + aps.exposure_us + round(row * aps.row_us))
    return found


def run(
    sensor: SensorParameters, ends_us: list[int], frames: list[F32] | None = None, seed: int = 3
) -> tuple[Events, PlainState]:
    model = PlainModel(sensor, 1, causes=True)
    state, parts, begin_us = model.init(seed), [], -1000
    for k, end_us in enumerate(ends_us):
        events, state = model.step(frames[k] if frames else GREY, state, begin_us, end_us)
        parts.append(events)
        begin_us = end_us
    return joined(parts), state


def joined(parts: list[Events]) -> Events:
    """One array, with the causes in the padding."""
    return np.frombuffer(b"".join(part.tobytes() for part in parts), EVENT_DTYPE)


def causes(events: Events) -> Any:
    return events.view(np.uint8).reshape(-1, 16)[:, 13]


@pytest.mark.parametrize("shutter", ["global", "rolling"])
@pytest.mark.parametrize("rate_hz", [100.0, 237.0])
def test_rows_are_read_before_and_after_each_exposure(shutter: str, rate_hz: float) -> None:
    aps = replace(APS, shutter=shutter, rate_hz=rate_hz)
    reads = RowReads(aps, ROWS)
    expected = sorted((t, row) for row in range(ROWS) for t in reads_us(aps, row, range(-9, 20)))
    generator = np.random.default_rng(1)
    edges = [-20_000, *np.cumsum(generator.integers(1, 3000, 30)) - 20_000]
    for begin_us, end_us in pairwise(edges):
        found = reads.within(int(begin_us), int(end_us))
        assert found.dtype == np.int32
        assert (np.diff(found[:, 1]) >= 0).all()
        told = sorted((int(begin_us) + t, row) for row, t in found.tolist())
        assert told == [read for read in expected if begin_us < read[0] <= end_us]


def test_still_pixels_that_leak_fire_at_their_rows_reads_and_at_no_other_time() -> None:
    """As in a still scene of a DAVIS346 with frames: the leak between two reads is less."""
    events, _ = run(LEAKY, list(range(0, 2_000_001, 1000)))
    # until the first read at 2 ms, pixels leak as ever
    late = events["t"] > 2300
    # 2 Hz of .2 log units sink by .004 between two reads
    assert set(causes(events)[late].tolist()) == {Cause.APS}
    events = events[late]
    assert (events["p"] == 1).all()
    for row in range(ROWS):
        moments = set(events["t"][events["y"] == row].tolist())
        assert moments <= set(reads_us(APS, row, range(202)))
        assert len(moments) > 100
    # a pixel goes on from its signal, so a period is shorter by less than the crosstalk
    without, _ = run(replace(LEAKY, aps=replace(APS, enabled=False)), [0, 2_000_000])
    assert set(causes(without).tolist()) == {Cause.LEAK}
    assert 1.0 < len(events) / len(without) < 0.2 / 0.19 * 1.03


@pytest.mark.parametrize("ends_us", [range(0, 50_001, 50), [0, *range(7, 50_001, 7), 50_000]])
def test_ticks_of_any_length_give_the_same_events_in_still_light(ends_us: Any) -> None:
    sensor = replace(
        LEAKY, leak_rate_hz=40.0, shot_noise_rate_hz=50.0, refractory_period_s=0.0005,
        hot_leak_median_hz=1.0,
    )  # fmt: skip
    once, state = run(sensor, [0, 50_000])
    cut, again = run(sensor, list(ends_us))
    assert set(causes(once).tolist()) == {Cause.LEAK, Cause.SHOT, Cause.HOT, Cause.APS}
    assert cut.tobytes() == once.tobytes()
    # the other counters are of ticks
    references = [caught_up(sensor, each).reference for each in (state, again)]
    assert np.array_equal(*references, equal_nan=True)


@pytest.mark.parametrize("tick_us", [100, 1700])
def test_native_is_the_oracle(tick_us: int) -> None:
    sensor = replace(
        LEAKY, width=10, cutoff_hz=300.0, follower_hz=900.0, highpass_hz=0.1, leak_rate_hz=20.0,
        shot_noise_rate_hz=100.0, refractory_period_s=0.0003, hot_leak_median_hz=1.0,
        aps=replace(APS, crosstalk=0.05, shutter="rolling"),
    )  # fmt: skip
    generator = np.random.default_rng(2)
    frames = [np.full((ROWS, 10), 0.3, np.float32) * np.float32(generator.uniform(0.5, 2))
              for _ in range(12)]  # fmt: skip
    oracle = ReferenceModel(sensor, causes=True)
    models = [PlainModel(sensor, 2, isa, causes=True) for isa in _core.isa_available()]
    expected, *states = (model.init(5) for model in (oracle, *models))
    seen = set()
    for k, frame in enumerate(frames):
        span = (k * tick_us, (k + 1) * tick_us)
        events, expected = oracle.step(frame, expected, *span)
        seen |= set(causes(events).tolist())
        for i, model in enumerate(models):
            ours, states[i] = model.step(frame, states[i], *span)
            assert ours.tobytes() == events.tobytes()
            assert caught_up(sensor, states[i]) == expected
    assert Cause.APS in seen or tick_us == 100


def test_a_saved_state_goes_on_with_the_same_bytes() -> None:
    whole, end = run(LEAKY, list(range(0, 300_001, 1000)))
    model = PlainModel(LEAKY, 1, causes=True)
    first, state = run(LEAKY, list(range(0, 150_001, 1000)))
    file = io.BytesIO()
    np.savez(file, **state.save())
    file.seek(0)
    with np.load(file) as saved:
        state = model.restore(saved)
    parts = [first]
    for begin_us in range(150_000, 300_000, 1000):
        events, state = model.step(GREY, state, begin_us, begin_us + 1000)
        parts.append(events)
    assert joined(parts).tobytes() == whole.tobytes()
    assert state == end


@pytest.mark.parametrize("name", ["davis240", "davis346"])
def test_presets_have_it_where_frames_are_on(name: str) -> None:
    off, on = (resolve_sensor(SensorConfig(name, aps=ApsConfig(enabled=k))) for k in (False, True))
    assert off.aps.crosstalk == on.aps.crosstalk > 0.0
    # of all leaks only the one below, and no noise, with which a pixel that is nearly there fires
    small = {"width": 64, "height": 32, "parasitic_leak_hz": 0.0, "hot_leak_median_hz": 0.0}
    small["photocurrent_pa"] = 0.0
    grey = np.full((32, 64), 0.5, np.float32)

    def counted(sensor: SensorParameters, leak_hz: float) -> tuple[int, int]:
        """Events of row reads and of leak in a second of still light, from 50 ms on."""
        model = PlainModel(replace(sensor, leak_rate_hz=leak_hz, **small), 1, causes=True)
        state, found = model.init(0), []
        for k in range(1000):
            events, state = model.step(grey, state, k * 1000, (k + 1) * 1000)
            found.append(causes(events))
        late = np.concatenate(found[50:])
        return int((late == Cause.APS).sum()), int((late == Cause.LEAK).sum())

    # 195 leak events are expected at .1 Hz; all of them come at reads
    assert counted(off, 0.1)[0] == 0
    assert 100 < counted(off, 0.1)[1] < 300
    reads, leaks = counted(on, 0.1)
    assert 100 < reads < 300
    assert leaks == 0
    # at 5 Hz a reference sinks by .02 from a read to the next, and the read takes a part of that
    reads, leaks = counted(on, 5.0)
    assert 0.05 < reads / (reads + leaks) < 0.2
