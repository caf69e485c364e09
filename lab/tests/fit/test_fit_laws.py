"""Leak and noise at two light levels."""

from __future__ import annotations

import numpy as np
import pytest

import evs
from evs_lab.fit import Light, Observed, fit_camera, sensor_toml
from reference import lamps

KEYS = {
    "pos_thres": 0.2,
    "neg_thres": 0.2,
    "dim_lux": 1.0,
    "leak_rate_hz": 0.3,
    "parasitic_leak_hz": 0.5,
    "shot_noise_rate_hz": 0.4,
    "shot_noise_bright": 0.25,
}


@pytest.mark.slow
@pytest.mark.statistical
def test_a_cap_and_a_still_view_tell_what_the_light_adds() -> None:
    base = evs.Pixels("ideal", dim_lux=1.0).sensor
    lights = [
        Light(lamps.dark(30.0, 11, **KEYS), "dark", 0.0),
        Light(lamps.dark(30.0, 12, 1000.0, **KEYS), "still", 1000.0),
    ]
    found = fit_camera(lights, base)
    for key in ("leak_rate_hz", "parasitic_leak_hz", "shot_noise_rate_hz", "shot_noise_bright"):
        one = found[key]
        assert abs(one.number - KEYS[key]) < 3.0 * one.error, key
        assert one.error < 0.2 * KEYS[key]
    assert not fit_camera(lights[:1], base)["parasitic_leak_hz"].told


@pytest.mark.statistical
@pytest.mark.parametrize(("preset", "photocurrent_pa"), [("davis346", 20.0), ("imx636", 25.0)])
def test_a_cap_tells_the_photocurrent_of_a_base_with_photon_noise(
    preset: str, photocurrent_pa: float
) -> None:
    base = evs.Pixels(preset).sensor
    size = (lamps.WIDTH, lamps.HEIGHT)
    pixels = evs.Pixels(preset, size=size, unit="lux", seed=3, photocurrent_pa=photocurrent_pa)
    black = np.zeros((lamps.HEIGHT, lamps.WIDTH), np.float32)
    cap = np.concatenate([pixels.observe(black, 20_000 * k) for k in range(1000)])
    seen = Observed(cap, lamps.WIDTH, lamps.HEIGHT, "cap")
    found = fit_camera([Light(seen, "dark", 0.0)], base)
    told = found["photocurrent_pa"]
    assert abs(told.number - photocurrent_pa) < 3.0 * told.error < 0.4 * photocurrent_pa
    assert "shot_noise_rate_hz" not in found.told
    text = sensor_toml(found, preset)
    assert "photocurrent_pa" in text
    assert "shot_noise_rate_hz" not in text
