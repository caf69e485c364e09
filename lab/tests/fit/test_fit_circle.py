"""The circle closed: sensors of evs with known parameters, fitted from their own recordings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import evs
from evs.emulator.sensor import SensorParameters
from evs_lab.fit import FittedCamera, Light, fit_camera
from reference import lamps

SENSORS = 20
FIRST = 200
"""sensors that no error term was set on"""

FIXED: dict[str, Any] = {"dim_lux": 1.0, "dark_lux": 0.01, "log": "ln", "shot_noise_bright": 0.3}

RANGES = {
    "pos_thres": "uniform(0.12, 0.3)",
    "neg_thres": "uniform(0.12, 0.3)",
    "sigma_thres": "uniform(0.01, 0.04)",
    "leak_rate_hz": "uniform(0.3, 1)",
    "shot_noise_rate_hz": "log_uniform(0.1, 0.6)",
    "noise_rate_cov_decades": "uniform(0.1, 0.3)",
    "dead_pixel_fraction": "uniform(0, 0.03)",
    "refractory_period_s": "log_uniform(5e-5, 2e-4)",
    "cutoff_hz": "log_uniform(100, 1000)",
}
"""every key has an estimate; noise does not hide the leak"""

TAIL = {
    "hot_leak_median_hz": "log_uniform(0.01, 0.05)",
    "hot_leak_cov_decades": "uniform(0.8, 1.1)",
}
"""of every other sensor"""


def drawn(episode: int) -> dict[str, Any]:
    ranges = RANGES | (TAIL if episode % 2 else {})
    sensor = evs.SensorRanges(ranges, evs.SensorConfig("ideal", **FIXED)).draw(5, episode)
    return {**FIXED, **sensor.values}


def base_of(**keys: Any) -> SensorParameters:
    return evs.Pixels("ideal", size=(lamps.WIDTH, lamps.HEIGHT), **keys).sensor


def fitted(values: dict[str, Any], seed: int, kind: str) -> FittedCamera:
    base = base_of(**FIXED, refractory_period_s=5e-6 if kind == "lamp" else 1e-4)
    if kind == "lamp":
        # each event of a flank takes along what passes while the pixel is blind
        quick = {**values, "refractory_period_s": 5e-6}
        return fit_camera([Light(lamps.lamp(seed, **quick), "lamp", 800.0, 8.0)], base)
    # a ramp is read at a light in which the pixel follows
    fast = {**values, "cutoff_hz": 0.0}
    cap = Light(lamps.dark(30.0, seed, **values), "dark", 0.0)
    return fit_camera([cap, Light(lamps.ramp(seed, **fast), "ramp", None, 4.0)], base)


def deviations(kind: str) -> dict[str, list[float]]:
    """Key -> (fitted - set) / standard error, over the sensors."""
    found: dict[str, list[float]] = {}
    for episode in range(FIRST, FIRST + SENSORS):
        values = drawn(episode)
        camera = fitted(values, 100 + episode, kind)
        for key, one in camera.told.items():
            whole_leak = "with its hot tail" in one.note and "hot_leak_median_hz" in values
            if key not in values or whole_leak:
                # with its tail, leak is something else than what was set
                continue
            found.setdefault(key, []).append((one.number - values[key]) / one.error)
    return found


@pytest.mark.slow
@pytest.mark.statistical
@pytest.mark.parametrize("kind", ["ramp", "lamp"])
def test_error_bars_cover_what_was_set(kind: str) -> None:
    found = deviations(kind)
    for key, values in found.items():
        z = np.array(values)
        print(f"{kind} {key:24s} {len(z):2d} told, rms {np.sqrt(np.mean(z**2)):.2f}, {z.round(1)}")
    # the keys that each recording is for are told for nearly all sensors
    wanted = {"pos_thres", "neg_thres", "sigma_thres", "dead_pixel_fraction"}
    noise = {"leak_rate_hz", "shot_noise_rate_hz", "noise_rate_cov_decades"}
    wanted |= {"cutoff_hz"} if kind == "lamp" else noise
    for key in wanted:
        least = SENSORS // 2 - 2 if key == "leak_rate_hz" else SENSORS - 3
        assert len(found.get(key, [])) >= least, key
    every = np.concatenate(list(found.values()))
    covered, count = int(np.sum(np.abs(every) < 2.0)), len(every)
    # 95.4 % of a normal distribution, within 3 standard deviations of a binomial count
    spread = 3.0 * math.sqrt(0.954 * 0.046 / count)
    print(f"{kind}: {covered} of {count} within 2, rms {np.sqrt(np.mean(every**2)):.3f}")
    assert 0.954 - spread < covered / count
    # errors that are too large fail too: the mean square has the deviation sqrt(2 / n) around 1,
    # but the systematic parts of the errors are upper bounds
    assert 0.5 < np.mean(every**2) < 1.0 + 3.0 * math.sqrt(2.0 / count)
