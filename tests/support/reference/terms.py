"""A setting of each term of the pixel alone, and the arrays of state that it needs: one table for
the tests of terms, of the whole pixel, of the plan and of the GPU."""

from __future__ import annotations

from typing import Any

TERMS: dict[str, dict[str, Any]] = {
    "threshold_spread": {"sigma_thres": 0.03},
    "rate_spread": {"noise_rate_cov_decades": 0.2},
    "defects": {"hot_leak_median_hz": 1.0},
    "low_pass": {"cutoff_hz": 200.0},
    "follower": {"follower_hz": 200.0},
    "high_pass": {"highpass_hz": 20.0},
    "leak": {"leak_rate_hz": 20.0},
    "parasitic_leak": {"parasitic_leak_hz": 50.0},
    "shot_noise": {"shot_noise_rate_hz": 200.0},
    "photon_noise": {"photocurrent_pa": 0.1, "dark_lux": 0.1, "follower_hz": 200.0},
    "refractory": {"refractory_period_s": 0.0005},
    "refractory_spread": {"refractory_period_s": 0.0005, "refractory_spread_decades": 0.2},
}
"""code path -> the parameters that switch it on"""

_SKIPS = {"due_us", "since_us"}
STATE = {
    "defects": _SKIPS,
    "low_pass": {"filtered", *_SKIPS},
    "follower": {"followed", *_SKIPS},
    "high_pass": _SKIPS,
    "leak": _SKIPS,
    "parasitic_leak": _SKIPS,
    "shot_noise": {"shot_next", "shot_count"},
    "photon_noise": {"followed", "noise_budget", "noise_mean", "noise_memory", *_SKIPS},
    "refractory": {"blind_until", *_SKIPS},
    "refractory_spread": {"blind_until", *_SKIPS},
}
"""code path -> the arrays of state that it has"""

ALL_TERMS = {
    **{key: value for keys in TERMS.values() for key, value in keys.items()},
    "sigma_thres": 0.03,
    "cutoff_hz": 300.0,
    "follower_hz": 900.0,
    "highpass_hz": 0.1,
    "leak_rate_hz": 5.0,
    "parasitic_leak_hz": 5.0,
    "shot_noise_rate_hz": 100.0,
    "refractory_period_s": 0.0003,
    "refractory_spread_decades": 0.0,
    "dead_pixel_fraction": 0.1,
    "photocurrent_pa": 0.0,
}
"""every term at once, but for photon noise"""
