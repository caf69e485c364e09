"""What pictures from events are made and judged with."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.sensor import PlainModel, SensorParameters
from evs.tools.reconstruction import complementary_filter, ssim
from reference.esim import EVENT, LOG_EPS, esim
from reference.reconstruction import fit, of_light

THRESHOLD, CUTOFF_RAD_S, TICK_US = 0.01, 6.0, 1000
RANDOM = np.random.default_rng(4)
SMOOTH = np.cumsum(RANDOM.normal(0, 0.02, (201, 12, 14)), axis=0)
"""log light: 200 ticks of a walk, from zero"""


def test_the_filter_of_two_events_is_its_closed_form() -> None:
    events = np.array([(30_000, 1, 0, 0), (10_000, 1, 0, 1)], EVENT)
    state = complementary_filter(events, (1, 3), [5_000, 10_000, 50_000], 0.2, CUTOFF_RAD_S)
    late = 0.2 * (np.exp(-CUTOFF_RAD_S * 0.04) - np.exp(-CUTOFF_RAD_S * 0.02))
    expected = [[[0, 0, 0]], [[0, 0.2, 0]], [[0, late, 0]]]
    assert state == pytest.approx(np.array(expected), abs=1e-15)


def test_events_are_read_once_however_often_the_state_is() -> None:
    events = np.array([(t, 0, 0, 1) for t in range(0, 90_000, 1000)], EVENT)
    often = complementary_filter(events, (1, 1), list(range(0, 100_001, 500)), 0.1, CUTOFF_RAD_S)
    once = complementary_filter(events, (1, 1), [100_000], 0.1, CUTOFF_RAD_S)
    assert often[-1] == pytest.approx(once[0], rel=1e-12)


def test_a_ramp_comes_through_the_filter_of_light_in_closed_form() -> None:
    ramp = np.linspace(0, 2, 201)[:, np.newaxis, np.newaxis]
    now_s = 0.15
    (read,) = of_light(ramp, TICK_US, [150_000], CUTOFF_RAD_S)
    slope = 2 / 0.2
    assert read[0, 0] == pytest.approx(slope * -np.expm1(-CUTOFF_RAD_S * now_s) / CUTOFF_RAD_S)


def test_events_of_a_film_give_the_filter_of_its_light_within_a_threshold() -> None:
    light = np.exp(SMOOTH) - LOG_EPS
    times = [50_000, 120_000, 200_000]
    events = esim(light, TICK_US, THRESHOLD, 0.0, 0)
    made = complementary_filter(events, SMOOTH.shape[1:], times, THRESHOLD, CUTOFF_RAD_S)
    true = of_light(SMOOTH - SMOOTH[0], TICK_US, times, CUTOFF_RAD_S)
    # what the events do not say yet is below a threshold, and the high pass at most doubles it
    assert np.abs(made - true).max() < 2 * THRESHOLD
    assert np.abs(true).max() > 20 * THRESHOLD


def test_esim_has_the_events_of_our_pixel_on_its_log_map() -> None:
    light = np.exp(SMOOTH).astype(np.float32)
    theirs = esim(light, TICK_US, 0.05, 0.0, 0)
    sensor = SensorParameters("esim", 14, 12, 0.05, 0.05, log="log_eps", log_eps=LOG_EPS)
    model = PlainModel(sensor, 1)
    state, parts = model.init(0), []
    for k, frame in enumerate(light):
        found, state = model.step(frame, state, TICK_US * (k - 1), TICK_US * k)
        parts.append(found[["t", "x", "y", "p"]])
    ours = np.concatenate(parts)
    assert len(theirs) > 3000
    for events in (ours, theirs):
        events.sort(order=["y", "x", "t", "p"])
    assert len(ours) == len(theirs)
    for name in "xyp":
        assert np.array_equal(ours[name], theirs[name])
    assert np.abs(ours["t"].astype(int) - theirs["t"]).max() <= 1


def test_a_fit_undoes_gain_and_offset_and_nothing_else() -> None:
    truth = RANDOM.normal(2, 1, (20, 24))
    same = fit(0.01 * truth - 7, truth)
    assert (same.correlation, same.ssim) == pytest.approx((1, 1))
    assert same.mse == pytest.approx(0, abs=1e-20)
    # a negative is not turned over, a blank has nothing to match
    for other in (-truth, np.zeros_like(truth)):
        found = fit(other, truth)
        assert found.correlation <= 0
        assert found.mse == pytest.approx(np.var(truth))
        assert found.picture == pytest.approx(np.full_like(truth, truth.mean()))
    noisy = fit(truth + RANDOM.normal(0, 1, truth.shape), truth)
    # 480 pixels: five standard deviations of a correlation of sqrt(1/2)
    assert noisy.correlation == pytest.approx(0.5**0.5, abs=5 * 0.5 / 480**0.5)
    assert noisy.mse == pytest.approx(np.var(truth) * (1 - noisy.correlation**2))


def test_ssim_of_a_shift_in_brightness_is_its_luminance_term() -> None:
    truth = np.tile([0.0, 1.0], (16, 8))
    means = 0.5, 0.7
    found = ssim(truth + 0.2, truth)
    c1 = 0.01**2
    term = (2 * means[0] * means[1] + c1) / (means[0] ** 2 + means[1] ** 2 + c1)
    # a window's own mean is 1/2 to within the smallest of its weights
    assert found == pytest.approx(term, abs=2e-3)
