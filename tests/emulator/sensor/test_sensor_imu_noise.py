"""The IMU's noise is as strong as it was set: direct variance, Allan deviation, walk over runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from evs.emulator.base.scene import CameraPose
from evs.emulator.sensor import Imu, ImuParameters
from evs.msgs import ImuSamples

pytestmark = pytest.mark.statistical

F64 = npt.NDArray[np.float64]

SET = ImuParameters(
    enabled=True,
    rate_hz=1000.0,
    accelerometer_noise_density=3e-2,
    gyroscope_noise_density=2e-3,
)
KEYS = {"acceleration": "accelerometer", "angular_velocity": "gyroscope"}
REST = {"acceleration": [0.0, -9.81, 0.0], "angular_velocity": [0.0, 0.0, 0.0]}
POSE = CameraPose(np.zeros(3), np.array([1.0, 0, 0, 0, 0, -1, 0, 1, 0]))
GRAVITY = np.array([0.0, 0.0, -9.81])


def still(parameters: ImuParameters, seconds: float, seed: int) -> ImuSamples:
    """What a camera at rest feels, from few long ticks: the stamps do not depend on them."""
    imu = Imu(parameters)
    state, parts = imu.init(seed), []
    for t_us in range(0, round(seconds * 1e6) + 200_001, 100_000):
        samples, state = imu.step(POSE, GRAVITY, state, t_us)
        parts.append(samples)
    return np.concatenate(parts)


@pytest.mark.parametrize("rate_hz", [1000.0, 200.0])
def test_white_noise_has_its_density_and_no_memory(rate_hz: float) -> None:
    samples = still(replace(SET, rate_hz=rate_hz), 40_000 / rate_hz, seed=1)
    n = len(samples)
    assert n > 39_000
    for key, sensor in KEYS.items():
        noise = samples[key] - REST[key]
        wanted = getattr(SET, f"{sensor}_noise_density") * math.sqrt(rate_hz)
        # of n normal numbers: mean sigma / sqrt(n), variance sqrt(2 / n); 5 sigma of 3 axes
        assert np.abs(noise.mean(axis=0)).max() < 5 * wanted / math.sqrt(n)
        assert noise.var(axis=0) / wanted**2 == pytest.approx(1.0, abs=5 * math.sqrt(2 / n))
        for lag in (1, 2, 7):
            memory = (noise[lag:] * noise[:-lag]).mean(axis=0) / wanted**2
            assert np.abs(memory).max() < 5 / math.sqrt(n)
        axes = np.corrcoef(noise.T)
        assert np.abs(axes - np.eye(3)).max() < 5 / math.sqrt(n)
    cross = np.corrcoef(samples["acceleration"][:, 0], samples["angular_velocity"][:, 0])[0, 1]
    assert abs(cross) < 5 / math.sqrt(n)


def test_white_noise_is_normal() -> None:
    noise = still(SET, 60.0, seed=4)["angular_velocity"].ravel() / (2e-3 * math.sqrt(1000))
    n = len(noise)
    # third and fourth moments of n normal numbers: sqrt(6 / n), sqrt(24 / n)
    assert abs((noise**3).mean()) < 5 * math.sqrt(15 / n)
    assert abs((noise**4).mean() - 3.0) < 5 * math.sqrt(96 / n)


def allan(values: F64, size: int) -> F64:
    """Allan deviation over clusters of `size` samples, (n, 3) -> (3,)."""
    count = len(values) // size
    means = values[: count * size].reshape(count, size, 3).mean(axis=1)
    deviation: F64 = np.sqrt(0.5 * (np.diff(means, axis=0) ** 2).mean(axis=0))
    return deviation


def test_the_allan_deviation_at_one_second_is_the_noise_density() -> None:
    samples = still(SET, 300.0, seed=2)
    for key, sensor in KEYS.items():
        for size in (10, 100, 1000):
            clusters = len(samples) // size
            wanted = getattr(SET, f"{sensor}_noise_density") / math.sqrt(size / 1000)
            # relative error of n - 1 differences that share their ends: sqrt(3 / (4 n)) of the
            # deviation (IEEE 952, white noise); 5 sigma
            assert allan(samples[key], size) / wanted == pytest.approx(
                1.0, abs=5 * math.sqrt(0.75 / clusters)
            )


def test_the_bias_walks_as_it_was_set() -> None:
    walking = replace(
        SET,
        accelerometer_noise_density=0.0,
        gyroscope_noise_density=0.0,
        accelerometer_random_walk=2e-2,
        gyroscope_random_walk=3e-3,
    )
    samples = still(walking, 60.0, seed=3)
    n = len(samples)
    for key, sensor in KEYS.items():
        wanted = getattr(walking, f"{sensor}_random_walk")
        steps = np.diff(samples[key], axis=0)
        # float32 of 9.81 m/s^2 rounds by 3e-7, steps are 6e-4
        assert steps.var(axis=0) / (wanted**2 / 1000) == pytest.approx(
            1.0, abs=5 * math.sqrt(2 / n)
        )
        # over 1 s it has gone sqrt(1000) steps' length: 59 such ways and 3 axes
        ways = samples[key][1000::1000] - samples[key][:-1000:1000][: len(samples[key][1000::1000])]
        assert ways.var() / wanted**2 == pytest.approx(1.0, abs=5 * math.sqrt(2 / ways.size))


def test_a_walk_begins_at_nothing_and_spreads_over_seeds() -> None:
    walking = replace(SET, accelerometer_noise_density=0.0, accelerometer_random_walk=2e-2)
    ends = np.array(
        [
            (still(walking, 0.4, seed)["acceleration"][299] - REST["acceleration"])
            for seed in range(150)
        ]
    )
    # 300 samples have passed: 0.3 s
    assert ends.var() / (2e-2**2 * 0.3) == pytest.approx(1.0, abs=5 * math.sqrt(2 / ends.size))
