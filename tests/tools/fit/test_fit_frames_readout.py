"""Thresholds from intensity frames beside events, and the readout from the stamps."""

from __future__ import annotations

import numpy as np
import pytest

import evs
from evs.tools.fit import Light, Observed, fit_camera, fit_frames, fit_readout
from reference import moving_texture

WIDTH, HEIGHT = 64, 48
SENSORS_FROM, SENSORS = 200, 20
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


def deviations(episodes: range) -> dict[str, list[float]]:
    """Key -> (fitted - set) / standard error, over random sensors; prints a table."""
    found: dict[str, list[float]] = {}
    # the refractory period that most recordings do not tell is wrong by a factor
    base = evs.Pixels("ideal", size=(WIDTH, HEIGHT), refractory_period_s=2e-4).sensor
    for episode in episodes:
        one = moving_texture.drawn(episode)
        camera = fit_camera([Light(moving_texture.recorded(episode, one))], base)
        cells = []
        for key, estimate in camera.told.items():
            if key not in one.sensor:
                continue
            z = (estimate.number - one.sensor[key]) / estimate.error
            found.setdefault(key, []).append(z)
            cells.append(
                f"{key} {one.sensor[key]:.3g} -> {estimate.number:.3g} "
                f"+- {estimate.error:.2g} ({z:+.1f})"
            )
        print(f"{episode} dark {one.dark}: {'; '.join(cells)}")
    return found


@pytest.mark.statistical
def test_frames_beside_events_tell_the_thresholds() -> None:
    """A soft texture, and hard edges beside a background that stands."""
    found = deviations(range(303, 305))
    for key in ("pos_thres", "neg_thres", "sigma_thres"):
        assert len(found[key]) == 2, key
    assert found["leak_rate_hz"]
    assert all(abs(z) < 3.0 for values in found.values() for z in values)
    # light that is not known tells nothing
    bare = Observed(drifting(0.3, 4000).events, WIDTH, HEIGHT, "bare")
    assert all("0 intensity frames" in one.reason for one in fit_frames(bare))


@pytest.mark.campaign
@pytest.mark.statistical
def test_error_bars_of_frames_cover_what_was_set() -> None:
    """Twenty sensors, none of those on which the systematic parts of the errors were set."""
    found = deviations(range(SENSORS_FROM, SENSORS_FROM + SENSORS))
    for key, values in found.items():
        z = np.array(values)
        within = [int(np.sum(np.abs(z) < limit)) for limit in (1.645, 2.0)]
        print(f"{key}: {len(z)} told, rms {np.sqrt(np.mean(z**2)):.2f}, within {within}")
    for key in ("pos_thres", "neg_thres", "sigma_thres"):
        assert len(found[key]) >= SENSORS - 3, key
        assert np.mean(np.abs(found[key]) < 1.645) >= 0.85, key
    every = np.concatenate(list(found.values()))
    assert np.mean(np.abs(every) < 2.0) >= 0.954 - 3.0 * np.sqrt(0.954 * 0.046 / len(every))
    # errors that are too large fail too, but their systematic parts are upper bounds
    assert np.mean(every**2) > 0.15


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
