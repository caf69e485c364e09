"""Leak and noise at two light levels."""

from __future__ import annotations

import pytest

import evs
from evs.tools.fit import Light, fit_camera
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
