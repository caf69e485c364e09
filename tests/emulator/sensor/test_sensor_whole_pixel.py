"""Every term of the pixel at the ends of its range: native gives the oracle's bytes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, PlainState, SensorParameters
from evs.emulator.sensor.pixel import MAX_CLOCK_US, MAX_TICK_US
from evs.emulator.sensor.running_mean import RunningMeanConstants
from evs.msgs import Events, EvsError, join_events
from reference.pixel.model import ReferenceModel, at_clock, caught_up
from reference.terms import ALL_TERMS as ALL

pytestmark = pytest.mark.extremes

SENSOR = SensorParameters("test", 10, 8, 0.2, 0.2, 0.03)
ALL_TERMS = replace(SENSOR, **ALL)

SILICON = replace(ALL_TERMS, log="ln", filter="large_signal")


def flat(value: float) -> F32:
    return np.full((8, 10), value, np.float32)


def steps(*values: float, each: int = 1) -> list[F32]:
    return [flat(value) for value in values for _ in range(each)]


def both(
    sensor: SensorParameters,
    frames: list[F32],
    tick_us: int = 1000,
    average: RunningMeanConstants | None = None,
    clock_us: int = 0,
) -> tuple[Events, np.ndarray, PlainState]:
    """Events, causes and native state; every instruction set gives the oracle's bytes."""
    oracle = ReferenceModel(sensor, average=average, causes=True)
    models = [
        PlainModel(sensor, 2, isa, average=average, causes=True) for isa in _core.isa_available()
    ]
    expected, *states = (at_clock(model.init(5), clock_us) for model in (oracle, *models))
    parts = []
    for k, frame in enumerate(frames):
        span = (k * tick_us, (k + 1) * tick_us)
        events, expected = oracle.step(frame, expected, *span)
        for i, model in enumerate(models):
            ours, states[i] = model.step(frame, states[i], *span)
            assert ours.tobytes() == events.tobytes()
            assert caught_up(sensor, states[i]) == expected
        parts.append(events)
    causes = [part.view(np.uint8).reshape(-1, 16)[:, 13] for part in parts]
    return join_events(parts), np.concatenate(causes), states[0]


@pytest.mark.parametrize("law", ["exact", "euler", "large_signal"])
@pytest.mark.parametrize("poles", [{"cutoff_hz": 40.0}, {"follower_hz": 40.0}], ids=str)
def test_filters_fade_to_black_without_denormals(law: str, poles: dict[str, float]) -> None:
    """Linear log light of black is 0: a filter would come ever closer to it."""
    # so much dim light that the bandwidth is the same in any
    sensor = replace(SENSOR, filter=law, dim_lux=1e6, **poles)  # type: ignore[arg-type]
    model = PlainModel(sensor, 1)
    _, state = model.step(flat(1.0), model.init(0), 0, 1000)
    values = []
    for k in range(1, 600):
        _, state = model.step(flat(0.0), state, k * 1000, (k + 1) * 1000)
        values.append(
            float(next(a for a in (state.filtered, state.followed) if a is not None)[0, 0])
        )
    assert values[0] > 1.0
    assert min(value for value in values if value) >= 2.0**-64
    assert values[-1] == 0.0
    # and then nothing is done any more
    assert state.since_us is not None
    assert state.since_us.max() < 600_000
    both(sensor, steps(1.0) + steps(0.0, each=250) + steps(1.0))


def test_a_pixel_in_the_sun_leaks_at_most_once_a_microsecond() -> None:
    sensor = replace(SENSOR, parasitic_leak_hz=1e4)
    events, causes, _ = both(sensor, steps(1e30, each=3), tick_us=100)
    assert len(events) == 2 * 100 * 80
    assert np.all(causes == 2)
    assert np.all(events["p"] == 1)


def test_a_block_that_slept_has_leaked_at_the_light_it_slept_in() -> None:
    sensor = replace(SENSOR, pos_thres=1.0, parasitic_leak_hz=1.0, leak_rate_hz=0.01)
    frames = steps(0.01, each=40) + steps(0.0101, 10.0, 0.0101) + steps(0.0101, each=40)
    both(sensor, frames)
    model = PlainModel(sensor, 1)
    _, asleep = model.step(flat(0.01), model.init(5), 0, 1000)
    for k in range(1, 30):
        _, asleep = model.step(flat(0.01), asleep, k * 1000, (k + 1) * 1000)
    assert asleep.since_us is not None
    assert np.all(asleep.since_us < 5000)  # it did sleep


@pytest.mark.parametrize("highpass_hz", [1e-9, 1e-6, 1e-3, 1e6])
@pytest.mark.parametrize("tick_us", [1, 1000])
def test_any_high_pass_beside_a_leak(highpass_hz: float, tick_us: int) -> None:
    sensor = replace(SENSOR, highpass_hz=highpass_hz, leak_rate_hz=1000.0)
    both(sensor, steps(0.1, 0.2, each=40), tick_us)


def test_a_leaking_reference_comes_within_reach_of_a_high_pass() -> None:
    """From .07 log units on, less than half a threshold, the reference follows by 2^-43 a us."""
    sensor = replace(SENSOR, width=1, height=1, highpass_hz=1.35e-7, leak_rate_hz=1e4)
    both(sensor, [np.full((1, 1), 0.1, np.float32)] * 250, 1)


@pytest.mark.parametrize("average", [None, RunningMeanConstants()], ids=["plain", "adaptive"])
@pytest.mark.parametrize("tick_us", [1, 2047, 50_000])
@pytest.mark.parametrize("sensor", [ALL_TERMS, SILICON], ids=["linear", "silicon"])
def test_all_terms_in_ticks_of_any_length(
    tick_us: int, average: RunningMeanConstants | None, sensor: SensorParameters
) -> None:
    frames = steps(0.1, 0.1, 0.5, 0.0, np.nan, 0.0, 1e9, -1.0, 1e-30, 0.3, 0.3, 0.3)
    events, causes, _ = both(sensor, frames, tick_us, average)
    # in a us no light comes through the filters
    assert set(causes.tolist()) >= ({2, 4} if tick_us == 1 else {1, 2, 3, 4})
    assert events["t"].min() > 0
    assert events["t"].max() <= len(frames) * tick_us


def test_ticks_of_four_minutes() -> None:
    sensor = replace(
        ALL_TERMS, leak_rate_hz=0.01, parasitic_leak_hz=0.01, shot_noise_rate_hz=0.025,
        hot_leak_median_hz=0.05, hot_leak_cov_decades=0.6, cutoff_hz=1e7,
    )  # fmt: skip
    events, causes, _ = both(sensor, steps(0.1, 0.1, 0.5, 0.5), MAX_TICK_US)
    assert len(events) > 2500
    assert set(causes.tolist()) == {1, 2, 3, 4}


def test_lowest_thresholds_and_highest_leak() -> None:
    sensor = replace(SENSOR, pos_thres=0.01, neg_thres=0.01, sigma_thres=0.1, leak_rate_hz=1e4)
    events, _, _ = both(sensor, steps(0.1, each=4) + steps(0.9, 0.1))
    assert len(events) > 80 * (3 * 10 + 100)


def test_blindness_of_many_ticks() -> None:
    sensor = replace(SENSOR, refractory_period_s=0.0105, leak_rate_hz=500.0)
    events, _, _ = both(sensor, steps(0.1, 0.3, each=40))
    order = np.lexsort((events["t"], events["x"], events["y"]))
    same = (np.diff(events["x"][order]) == 0) & (np.diff(events["y"][order]) == 0)
    waits = np.diff(events["t"][order])[same]
    assert len(waits) > 200
    assert 10_500 < waits.min() < 10_510 + 2000


def test_the_longest_blindness_outlasts_everything() -> None:
    sensor = replace(SENSOR, refractory_period_s=100.0)
    events, _, state = both(sensor, steps(0.1, 1.0, 0.1, 1.0, 0.1))
    assert len(events) == 80
    assert np.all(np.isnan(state.reference))


def test_a_sensor_of_dead_pixels_is_silent() -> None:
    sensor = replace(ALL_TERMS, hot_leak_median_hz=0.0, dead_pixel_fraction=1.0)
    events, _, state = both(sensor, steps(0.1, 1.0, 0.1, 1e6))
    assert len(events) == 0
    assert state.shot_count is not None
    assert np.all(state.shot_count == 1)


def test_a_sensor_of_hot_pixels_says_so() -> None:
    sensor = replace(SENSOR, hot_leak_median_hz=1e3, hot_leak_cov_decades=0.0)
    events, causes, _ = both(sensor, steps(0.1, each=101))
    assert np.all(causes == 4)
    assert abs(len(events) - 80 * 100) <= 80


def test_a_bandwidth_that_is_no_limit_shows_the_light() -> None:
    sensor = replace(SENSOR, cutoff_hz=1e7, follower_hz=1e7)
    slow, _, state = both(sensor, steps(0.1, 1.0, 0.2))
    assert state.followed is not None
    # a pole is 1 / w behind a line: of the last tick's ln 5, in light of 200 lux
    z = 2 * np.pi * 1e7 * 1e-3
    first = z * (200 + sensor.dim_lux) / (sensor.bright_lux + sensor.dim_lux)
    behind = np.log(5) * (1 / first + 1 / z)
    assert state.followed - state.last_log == pytest.approx(behind, rel=0.02)
    fast, _, _ = both(SENSOR, steps(0.1, 1.0, 0.2))
    assert len(slow) == len(fast)


def test_a_sensor_lives_for_142_years_and_then_says_so() -> None:
    sensor = replace(ALL_TERMS, shot_noise_rate_hz=1e4)
    start = MAX_CLOCK_US - 6500
    events, causes, state = both(sensor, steps(0.1, 0.3, each=3), clock_us=start)
    assert np.count_nonzero(causes == 3) > 100
    with pytest.raises(EvsError, match="past its end; call init again"):
        PlainModel(sensor, 1).step(flat(0.1), state, 6000, 7000)
    first, _, _ = both(sensor, steps(0.1, 0.3, each=3))
    assert first.tobytes() == events.tobytes()


def test_rates_of_nearly_never_are_refused() -> None:
    for key in ("cutoff_hz", "follower_hz", "highpass_hz", "leak_rate_hz", "parasitic_leak_hz"):
        with pytest.raises(EvsError, match=f"sensor.{key} is 1e-12; give 0 or over 1e-09"):
            replace(SENSOR, **{key: 1e-12})  # type: ignore[arg-type]
        replace(SENSOR, **{key: 1e-9})  # type: ignore[arg-type]
