"""Thresholds from intensity frames beside events, and the readout from the stamps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest

import evs
from evs_lab.fit import (
    Estimate,
    FittedCamera,
    Light,
    Observed,
    cut_to_frames,
    fit_camera,
    fit_frames,
    fit_readout,
    replayed,
)
from evs_lab.fit import frames as frames_fit
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


def cameras(episodes: range) -> Iterator[tuple[int, FittedCamera]]:
    """Random sensors, each fitted to its recording."""
    # the refractory period that most recordings do not tell is wrong by a factor
    base = evs.Pixels("ideal", size=(WIDTH, HEIGHT), refractory_period_s=2e-4).sensor
    for episode in episodes:
        yield episode, fit_camera([Light(moving_texture.recorded(episode))], base)


def deviations(fitted: Iterable[tuple[int, FittedCamera]]) -> dict[str, list[float]]:
    """Key -> (fitted - set) / standard error, over random sensors; prints a table."""
    found: dict[str, list[float]] = {}
    for episode, camera in fitted:
        one = moving_texture.drawn(episode)
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
    fitted = list(cameras(range(303, 305)))
    found = deviations(fitted)
    for key in ("pos_thres", "neg_thres", "sigma_thres"):
        assert len(found[key]) == 2, key
    assert found["leak_rate_hz"]
    assert all(abs(z) < 3.0 for values in found.values() for z in values)
    # the right sensor in the light of the frames: frames miss what comes and goes between them
    for (episode, camera), most_missed in zip(fitted, (0.2, 0.5), strict=True):
        one = moving_texture.drawn(episode)
        light = cut_to_frames(camera.lights[0])
        assert abs(light.dark_dn - one.dark) < 8.0
        dark = replace(light, dark_dn=float(one.dark))
        replay = replayed(dark, evs.SensorConfig("ideal", **moving_texture.LAWS, **one.sensor))
        assert replay is not None
        assert len(replay.events) > (1.0 - most_missed) * len(light.seen.events)
        assert abs(replay.on.mean() - light.seen.on.mean()) < 0.006
        # noise of frames is no light
        standing = int(WIDTH * one.scene["still"])
        counts = [np.count_nonzero(o.events["x"] < standing) for o in (replay, light.seen)]
        assert abs(counts[0] - counts[1]) <= 0.05 * counts[1]
    # light that is not known tells nothing
    bare = Observed(drifting(0.3, 4000).events, WIDTH, HEIGHT, "bare")
    assert all("0 intensity frames" in one.reason for one in fit_frames(bare)[0])


@pytest.mark.campaign
@pytest.mark.statistical
def test_error_bars_of_frames_cover_what_was_set() -> None:
    """Twenty sensors, none of those on which the systematic parts of the errors were set."""
    found = deviations(cameras(range(SENSORS_FROM, SENSORS_FROM + SENSORS)))
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


def test_totals_set_the_ratio_that_windows_miss() -> None:
    """What a street's windows gave: too low for ON, too high for OFF, and a leak below zero."""
    on, off, seconds, leak_hz = 0.25, 0.28, 3000.0, 0.1
    offs, change = 15_000.0, -150.0
    ons = (change + on * leak_hz * seconds + off * offs) / on
    totals = frames_fit._Totals(ons, offs, change, seconds, 300_000.0, 2500)
    windows = [Estimate("pos_thres", 0.21, 0.035), Estimate("neg_thres", 0.31, 0.05)]
    best = frames_fit._Solution(np.zeros(3), np.zeros(3), (0.02, 0.01), 0.1, 1.0, 0.0)
    leak = Estimate("leak_rate_hz", leak_hz, 0.01)
    fitted = frames_fit._balanced(windows, leak, totals, best)
    assert abs(fitted[1].number / fitted[0].number / (off / on) - 1.0) < 0.05
    assert abs(fitted[0].number * fitted[1].number / (0.21 * 0.31) - 1.0) < 0.02
    assert [one.error for one in fitted] == [0.035, 0.05]
    # light that only rises has no balance
    rising = replace(totals, ons=1000.0, offs=10.0, change=250.0)
    assert frames_fit._balanced(windows, leak, rising, best) == windows
