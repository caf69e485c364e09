"""The rate of photon noise that follows from the parameters, against what the bench measures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from evs.emulator.config import SensorConfig
from evs.emulator.sensor import SensorParameters, resolve_sensor
from evs.emulator.sensor.noise_rate import noise_rate_hz, photon_rate_hz, shot_rate_hz
from evs_lab.characterise.background import background_results, measure_background
from evs_lab.characterise.bench import Bench

pytestmark = pytest.mark.statistical

SIDE = 50
QUIET: dict[str, Any] = {"hot_leak_median_hz": 0.0}


def chip(name: str, **more: Any) -> SensorParameters:
    """A preset with few pixels, none of them hot."""
    return replace(resolve_sensor(SensorConfig(name)), width=SIDE, height=SIDE, **QUIET, **more)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "ladder_lux"), [("davis346", [0.01, 0.1, 1.0]), ("imx636", [0.1, 1.0, 5.0])]
)
def test_photon_noise_has_the_rate_that_follows_from_its_poles(
    name: str, ladder_lux: list[float]
) -> None:
    """Within 10 %: what the fits of the model leave, and thresholds that are not their mean."""
    sensor = chip(name)
    for at in measure_background(Bench(sensor, 3, 1), ladder_lux):
        rate, error = at.shot
        assert rate == pytest.approx(photon_rate_hz(sensor, at.lux), abs=0.1 * rate + 4 * error)
        # noise hides no leak
        assert abs(at.leak[0] - sensor.leak_rate_hz) < 0.01 + 4 * at.leak[1]


@pytest.mark.parametrize(
    ("name", "quantity", "lux"),
    [("dvxplorer", "shot noise rate", 10.0), ("davis346", "rate of hot pixels", 100.0)],
)
def test_set_and_measured_are_of_the_same_pixels(name: str, quantity: str, lux: float) -> None:
    """Few pixels of a DVXplorer have most of its noise, and hot ones many events in a tick."""
    sensor = replace(resolve_sensor(SensorConfig(name)), width=60, height=SIDE)
    found = measure_background(Bench(sensor, 0, 1), [lux])
    [result] = [one for one in background_results(sensor, found) if one.quantity == quantity]
    assert result.error < 0.3 * result.set
    assert abs(result.sigmas) < 4.0


def test_photon_noise_is_expected_in_the_dark_only() -> None:
    sensor = chip("davis346")
    rates = [photon_rate_hz(sensor, lux) for lux in (0.0, 0.1, 0.3, 1.0, 10.0, 1000.0)]
    assert 5.0 < rates[0] < rates[1] < rates[2] > rates[3] > rates[4] > rates[5] == 0.0
    assert photon_rate_hz(replace(sensor, photocurrent_pa=0.0), 0.1) == 0.0
    # more light in the same bandwidth is less noise, more bandwidth in the same light is more
    assert photon_rate_hz(replace(sensor, photocurrent_pa=64.0), 0.1) < 0.5 * rates[1]
    assert photon_rate_hz(replace(sensor, cutoff_hz=324e3), 0.1) > 2.0 * rates[1]
    # equal thresholds and no leak: every reference stays where it began
    still = replace(sensor, sigma_thres=0.0, leak_rate_hz=0.0, parasitic_leak_hz=0.0)
    assert 0.0 < photon_rate_hz(still, 0.1) < rates[1]


def test_both_noises_add_up() -> None:
    both = chip("davis346", shot_noise_rate_hz=2.0)
    assert shot_rate_hz(both, 0.0) == pytest.approx(2.0, rel=1e-3)
    total = shot_rate_hz(both, 0.3) + photon_rate_hz(both, 0.3)
    assert noise_rate_hz(both, 0.3) == total
