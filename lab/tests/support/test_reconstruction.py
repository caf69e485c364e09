"""What pictures from events are made and judged with."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.sensor import PlainModel, SensorParameters
from evs_lab.reconstruction import complementary_filter
from reference.esim import LOG_EPS, esim
from reference.reconstruction import fit, of_light

THRESHOLD, CUTOFF_RAD_S, TICK_US = 0.01, 6.0, 1000
RANDOM = np.random.default_rng(4)
SMOOTH = np.cumsum(RANDOM.normal(0, 0.02, (201, 12, 14)), axis=0)
"""log light: 200 ticks of a walk, from zero"""


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
