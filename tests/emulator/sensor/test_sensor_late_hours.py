"""After a day, and after years: the same events as in the first second, and the same noise.

lab/tests/bench/test_sensor_day.py lives through the whole day; this starts at its end.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy

from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, PlainState, SensorParameters
from evs.emulator.sensor.pixel import MAX_TICK_US
from evs.msgs import Events, join_events
from reference.waves import Waves

pytestmark = pytest.mark.extremes

SIDE, TICK_US, SECOND_US = 24, 1000, 1_000_000
DAY_US = 86_400 * SECOND_US
YEAR_US = 365 * DAY_US
IDEAL = SensorParameters("ideal", SIDE, SIDE, 0.2, 0.2, 0.03, exposure_dn=1.0)


def wait(
    model: PlainModel, light: F32, state: PlainState, begin_us: int, until_us: int
) -> PlainState:
    """The state after still light; its events are left out."""
    while begin_us < until_us:
        end_us = min(begin_us + MAX_TICK_US, until_us)
        _, state = model.step(light, state, begin_us, end_us)
        begin_us = end_us
    return state


def watch(
    model: PlainModel, light: list[F32], state: PlainState, begin_us: int
) -> tuple[Events, PlainState]:
    parts = []
    for frame in light:
        events, state = model.step(frame, state, begin_us, begin_us + TICK_US)
        assert np.all((events["t"] > begin_us) & (events["t"] <= begin_us + TICK_US))
        parts.append(events)
        begin_us += TICK_US
    return join_events(parts), state


@pytest.mark.parametrize(
    "begin_us",
    [2**31 - 100_000, 2**32 - 100_000, DAY_US, 30 * DAY_US, 100 * YEAR_US],
    ids=["int32", "uint32", "day", "month", "century"],
)
def test_the_same_light_has_the_same_events_at_any_time(begin_us: int) -> None:
    """Noise off: every stamp is as in the first second, that much later; so is all state."""
    waves = Waves.of(SIDE, 4.0, 5)
    light = [waves.luminance(k * TICK_US) for k in range(300)]
    model = PlainModel(IDEAL, 1)
    first, after = watch(model, light, model.init(0), 0)
    late, later = watch(model, light, model.init(0), begin_us)
    assert len(first) > 3000
    assert np.array_equal(late["t"] - begin_us, first["t"])
    for name in "xyp":
        assert np.array_equal(late[name], first[name])
    assert later == after


def test_a_day_of_waiting_leaves_ideal_pixels_as_they_were() -> None:
    waves = Waves.of(SIDE, 4.0, 5)
    light = [np.full((SIDE, SIDE), 50.0, np.float32)] + [
        waves.luminance(k * TICK_US) for k in range(300)
    ]
    model = PlainModel(IDEAL, 1)
    first, _ = watch(model, light, model.init(0), 0)
    _, state = watch(model, light[:1], model.init(0), 0)
    state = wait(model, light[0], state, TICK_US, DAY_US + TICK_US)
    late, _ = watch(model, light[1:], state, DAY_US + TICK_US)
    assert np.array_equal(late["t"] - DAY_US, first["t"])
    for name in "xyp":
        assert np.array_equal(late[name], first[name])


@pytest.mark.statistical
@pytest.mark.slow
def test_after_a_day_noise_has_its_rates_and_its_stamps() -> None:
    """Twenty seconds of still light at the start, and after 24 h by the sensor's own clock."""
    side = 8
    sensor = replace(
        IDEAL, width=side, height=side, leak_rate_hz=1.0, shot_noise_rate_hz=8.0,
        noise_rate_cov_decades=0.1, refractory_period_s=0.001, hot_leak_median_hz=0.3,
        hot_leak_cov_decades=0.9, cutoff_hz=300.0, follower_hz=1000.0,
    )  # fmt: skip
    model = PlainModel(sensor, 1)
    light = np.full((side, side), 50.0, np.float32)
    state = wait(model, light, model.init(0), -SECOND_US, 0)
    first, state = watch(model, [light] * 20_000, state, 0)
    state = wait(model, light, state, 20 * SECOND_US, DAY_US)
    assert state.clock_us == DAY_US + SECOND_US
    late, state = watch(model, [light] * 20_000, state, DAY_US)
    # per pixel and polarity, both Poisson at most; significance 1e-3
    pixel = [
        np.bincount((e["y"].astype(int) * side + e["x"]) * 2 + e["p"], minlength=2 * side**2)
        for e in (first, late)
    ]
    a, b = (counts.astype(float) for counts in pixel)
    assert a.sum() > 6_000
    chi_square = ((a - b) ** 2 / np.maximum(a + b, 1)).sum()
    assert chi_square < scipy.stats.chi2.ppf(0.999, np.count_nonzero(a + b))
    for p in (0, 1):
        total, later = a[p::2].sum(), b[p::2].sum()
        assert abs(total - later) < 3.3 * math.sqrt(total + later)
    # every microsecond of a tick still has its share: nothing is rounded coarser
    place = np.bincount((late["t"] - 1) % TICK_US, minlength=TICK_US)
    assert scipy.stats.chisquare(place).pvalue > 1e-3
    # and it is other noise, not the same again
    assert not np.array_equal(late["t"] - DAY_US, first["t"])
