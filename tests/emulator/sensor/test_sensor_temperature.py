"""Dark current and leak by the temperature of the chip, and leak by the light."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.fixed_pattern import draw_pattern
from evs.emulator.sensor.pixel import log_light

SENSOR = SensorParameters("test", 64, 48, 0.2, 0.2, log="ln", dark_lux=0.1)


def flat(lux: float, sensor: SensorParameters = SENSOR) -> F32:
    return np.full((sensor.height, sensor.width), lux / 1000.0, np.float32)


def leak_hz(sensor: SensorParameters, lux: float, seconds: int) -> float:
    """ON events of a pixel and second in constant light."""
    model = PlainModel(sensor, 1)
    _, state = model.step(flat(lux, sensor), model.init(1), -1000, 0)
    events = 0
    for k in range(seconds):
        found, state = model.step(flat(lux, sensor), state, k * 1_000_000, (k + 1) * 1_000_000)
        assert np.all(found["p"] == 1)
        events += len(found)
    return events / seconds / (sensor.width * sensor.height)


def test_at_25_degrees_nothing_changes() -> None:
    sensor = replace(SENSOR, leak_rate_hz=0.3, noise_rate_cov_decades=0.2)
    same = replace(sensor, temperature_c=25.0)
    assert same.thermal_factor == 1.0
    assert same.dark_dn == sensor.dark_lux / sensor.lux_per_dn
    ours, theirs = draw_pattern(sensor, 3).leak, draw_pattern(same, 3).leak
    assert ours is not None
    assert theirs is not None
    assert ours.tobytes() == theirs.tobytes()


def test_dark_current_doubles_about_every_8_degrees() -> None:
    """Arrhenius with 0.63 eV; published energies of 0.56 and 1.12 eV are 9.5 and 4.7 degrees."""
    warmer = [replace(SENSOR, temperature_c=c).dark_dn for c in (17.0, 25.0, 33.0, 41.0, 49.0)]
    ratios = np.array(warmer[1:]) / warmer[:-1]
    assert np.all((ratios > 1.7) & (ratios < 2.2))
    assert np.all(np.diff(ratios) < 0)  # an exponential of 1 / T, not of T
    exact = math.exp(0.63 / 8.617333262e-5 * (1 / 298.15 - 1 / 333.15))
    assert replace(SENSOR, temperature_c=60.0).thermal_factor == pytest.approx(exact, rel=1e-8)


def test_the_dark_current_is_the_floor_of_the_light() -> None:
    hot = replace(SENSOR, temperature_c=60.0)
    black = np.zeros(1, np.float32)
    rise = log_light(black, hot)[0] - log_light(black, SENSOR)[0]
    assert rise == pytest.approx(math.log(hot.thermal_factor), abs=1e-5)


@pytest.mark.statistical
def test_leak_grows_with_temperature_and_with_light_but_not_with_both() -> None:
    """Of every pixel the same leak, in phases of its own: rates within one event a pixel."""
    sensor = replace(SENSOR, leak_rate_hz=0.1, parasitic_leak_hz=0.06)
    seconds = 60
    # the parasitic photocurrent is proportional to the light and knows no temperature
    for celsius, lux in ((25.0, 161.0), (25.0, 3000.0), (50.0, 161.0), (50.0, 3000.0)):
        now = replace(sensor, temperature_c=celsius)
        expected = 0.1 * now.thermal_factor + 0.06 * (lux + now.dark_current_lux) / 1000.0
        found = leak_hz(now, lux, seconds)
        # each pixel has floor or ceil of its leak, evenly: half an event, less by sqrt of pixels
        bound = 4 * 0.5 / seconds / math.sqrt(sensor.width * sensor.height)
        assert abs(found - expected) < bound + 1e-4 * expected


def test_a_pixel_leaks_at_most_once_a_microsecond_however_hot() -> None:
    sensor = replace(SENSOR, leak_rate_hz=1e4, temperature_c=125.0, noise_rate_cov_decades=1.0)
    pattern = draw_pattern(sensor, 5)
    assert pattern.leak is not None
    assert np.all(pattern.leak <= pattern.on)
    assert np.any(pattern.leak == pattern.on)
