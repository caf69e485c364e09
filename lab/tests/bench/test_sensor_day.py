"""A day of simulated time at 1 kHz, 86.4 million ticks of 8 x 8 pixels: nothing drifts or wraps.

It keeps one core busy for half an hour, so `make bench` leaves it out; run it with
`.venv/bin/pytest -m bench -s lab/tests/bench/test_sensor_day.py`. The faster checks are in
tests/emulator/sensor/test_sensor_late_hours.py.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from scipy import stats

from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, PlainState, SensorParameters
from evs.msgs import Events, join_events
from reference.memory import resident_bytes
from reference.waves import Waves

SIDE, TICK_US, SECOND, HOUR, DAY = 8, 1000, 1000, 3_600_000, 86_400_000
IDEAL = SensorParameters("ideal", SIDE, SIDE, 0.2, 0.2, exposure_dn=1.0)


def seconds(
    model: PlainModel, light: F32, state: PlainState
) -> Iterator[tuple[Events, PlainState]]:
    """Simulate a day, second by second.

    Args:
        model: The sensor.
        light: Luminance (1000, h, w), one frame per tick of 1 ms, the same in every second.
        state: The state of the sensor before the day.

    Yields:
        The events of each second, and the state after it.
    """
    _, state = model.step(light[-1], state, -TICK_US, 0)
    frames = list(light)
    for second in range(DAY // SECOND):
        parts, begin_us = [], second * SECOND * TICK_US
        for frame in frames:
            events, state = model.step(frame, state, begin_us, begin_us + TICK_US)
            parts.append(events)
            begin_us += TICK_US
        found = join_events([part for part in parts if len(part)])
        # sorted, and each event inside its own tick
        tick = np.repeat(np.arange(SECOND), [len(part) for part in parts])
        assert np.array_equal((found["t"] - 1) // TICK_US - second * SECOND, tick)
        assert np.all(np.diff(found["t"]) >= 0)
        yield found, state


def report(second: int, began: float, events: int) -> None:
    if (second + 1) % (HOUR // SECOND) == 0:
        print(
            f"\n  {(second + 1) // (HOUR // SECOND):2d} h simulated, "
            f"{time.perf_counter() - began:6.0f} s, {resident_bytes() / 2**20:.1f} MiB, "
            f"{events} events",
            end="",
            flush=True,
        )


@pytest.mark.bench
@pytest.mark.slow
def test_a_day_without_noise_repeats_to_the_bit() -> None:
    """Light with a period of one second gives the same events in every second of the day."""
    waves = Waves.of(SIDE, 4.0, 3, whole=True)
    light = np.stack([waves.luminance((k + 1) * TICK_US) for k in range(SECOND)])
    model = PlainModel(IDEAL, 1)
    began, events, first = time.perf_counter(), 0, None
    for second, (found, state) in enumerate(seconds(model, light, model.init(0))):
        events += len(found)
        found["t"] -= second * SECOND * TICK_US
        # the first second has another past
        if second == 1:
            first, kept = found.tobytes(), state.reference.copy()
            assert len(found) > 1000
        if second > 1:
            assert found.tobytes() == first
            assert np.array_equal(state.reference, kept)
        report(second, began, events)
        if second == 60:
            memory = resident_bytes()
    # a leak of 16 bytes every two thousand ticks would exceed this
    assert resident_bytes() - memory < 2**19


@pytest.mark.bench
@pytest.mark.slow
def test_a_day_of_noise_keeps_its_rates() -> None:
    """Every term of the pixel is on; the left half sees moving light, the right still light."""
    sensor = SensorParameters(
        "noisy", SIDE, SIDE, 0.2, 0.2, 0.03, exposure_dn=1.0,
        cutoff_hz=200.0, follower_hz=1000.0, highpass_hz=0.01,
        leak_rate_hz=0.5, parasitic_leak_hz=0.5, shot_noise_rate_hz=1.0,
        noise_rate_cov_decades=0.1, refractory_period_s=0.0005, hot_leak_median_hz=0.3,
        hot_leak_cov_decades=0.9,
    )  # fmt: skip
    waves = Waves.of(SIDE, 4.0, 3, whole=True)
    light = np.stack([waves.luminance((k + 1) * TICK_US) for k in range(SECOND)])
    light[:, :, SIDE // 2 :] = light[0, :, SIDE // 2 :]
    model = PlainModel(sensor, 1)
    began, events = time.perf_counter(), 0
    hours = np.zeros((DAY // HOUR, 2, 2), np.int64)  # [hour, moving or still light, OFF or ON]
    copy = None
    for second, (found, state) in enumerate(seconds(model, light, model.init(0))):
        events += len(found)
        still = (found["x"] >= SIDE // 2).astype(np.int64)
        hours[second // (HOUR // SECOND)] += np.bincount(
            still * 2 + found["p"], minlength=4
        ).reshape(2, 2)
        # once an hour, a copy that was saved and restored simulates the same second
        if copy is not None:
            begin_us, parts = second * SECOND * TICK_US, []
            other = PlainModel(sensor, 1)
            for k, frame in enumerate(light):
                t_us = begin_us + k * TICK_US
                part, copy = other.step(frame, copy, t_us, t_us + TICK_US)
                parts.append(part)
            assert join_events(parts).tobytes() == found.tobytes()
            assert copy == state
            copy = None
        if second % (HOUR // SECOND) == HOUR // SECOND - 2:
            copy = PlainState.restore(state.save())
        report(second, began, events)
    print()
    for kind, name in enumerate(("moving", "still")):
        for polarity, sign in enumerate(("OFF", "ON")):
            counts = hours[1:, kind, polarity]  # the sensor settles in the first hour
            print(f"  {name} {sign}: {counts.mean() / 3600 / 32:.4f} Hz a pixel, "
                  f"hours {counts.min()} ... {counts.max()}, chi-square "
                  f"{((counts - counts.mean()) ** 2 / counts.mean()).sum():.1f} of 22")  # fmt: skip
            # no hour differs from the others (noise varies as Poisson, leak and light less)
            chi_square = ((counts - counts.mean()) ** 2 / counts.mean()).sum()
            assert chi_square < stats.chi2.ppf(1 - 1e-4, len(counts) - 1)
            # and there is no trend: the slope against its deviation for Poisson counts
            x = np.arange(len(counts)) - (len(counts) - 1) / 2
            slope = (x * counts).sum() / (x**2).sum()
            assert abs(slope) < 4 * np.sqrt(counts.mean() / (x**2).sum())
