"""Thresholds from intensity frames beside events, and the readout from the stamps."""

from __future__ import annotations

import numpy as np
import pytest

import evs
from evs.tools.fit import Observed, fit_frames, fit_readout

WIDTH, HEIGHT = 64, 48
X, Y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))


def drifting(seconds: float, every_us: int, **keys) -> Observed:
    """A soft pattern that drifts, of 18 to 200 DN."""
    pixels = evs.Pixels("ideal", size=(WIDTH, HEIGHT), unit="dn", seed=4, **keys)
    parts, frames = [], []
    for t_us in range(0, round(seconds * 1e6), every_us):
        phase = 2.0 * np.pi * (X / 40 + Y / 70 - 0.4e-6 * t_us)
        light = 60.0 * np.exp(0.8 * np.sin(phase) + 0.3 * np.sin(2.3 * phase + 1.0))
        parts.append(pixels.observe(light.astype(np.float32), t_us))
        frames += pixels.frames
    return Observed(np.concatenate(parts), WIDTH, HEIGHT, "drift", tuple(frames))


@pytest.mark.statistical
def test_frames_beside_events_tell_the_thresholds() -> None:
    aps = {"aps.enabled": True, "aps.rate_hz": 25.0, "aps.exposure_us": 5000}
    seen = drifting(3.0, 4000, pos_thres=0.24, neg_thres=0.18, sigma_thres=0.02, **aps)
    found = {one.key: one for one in fit_frames(seen)}
    for key, value in (("pos_thres", 0.24), ("neg_thres", 0.18), ("sigma_thres", 0.02)):
        assert abs(found[key].number - value) < 3.0 * found[key].error, key
        assert found[key].error < 0.35 * value
    # light that is not known tells nothing
    bare = Observed(seen.events, WIDTH, HEIGHT, "bare")
    assert all("0 intensity frames" in one.reason for one in fit_frames(bare))


def test_a_scan_shows_in_the_intervals() -> None:
    scan = {"order": "scan", "scan_us": 200, "scan_column_ns": 2500}
    keys = {f"readout.{key}": value for key, value in scan.items()}
    seen = drifting(1.0, 1000, pos_thres=0.1, neg_thres=0.1, sigma_thres=0.01, **keys)
    found = {one.key: one for one in fit_readout(seen)}
    assert found["readout.order"].value == "scan"
    assert found["readout.scan_us"].number == 200.0
    pace = found["readout.scan_column_ns"]
    assert abs(pace.number - 2500.0) < 4.0 * pace.error < 250.0
    plain = drifting(1.0, 1000, pos_thres=0.1, neg_thres=0.1, sigma_thres=0.01)
    assert not any(one.told for one in fit_readout(plain) if "scan" in one.key)
