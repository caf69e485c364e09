"""Light to X."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.dense import LogDelta
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.pixel import log_light
from reference.networks import through_network

SENSOR = SensorParameters("test", 9, 4, 0.2, 0.2, exposure_dn=200.0, dark_lux=2.0, white_lux=255.0)


def dark(shape: tuple[int, int] = (4, 9)) -> NetworkState:
    return NetworkState.dark(0, "none", "none", np.zeros(shape, np.float32), {})


def steps_of(
    values: list[float], sensor: SensorParameters | None = None
) -> tuple[F32, NetworkState]:
    """X of one pixel."""
    sensor = sensor or SensorParameters("one", 1, 1, 0.2, 0.2)
    state = dark((1, 1))
    film = np.array(values, np.float32).reshape(-1, 1, 1)
    return LogDelta.of(sensor, through_network()).step(film, state).reshape(-1), state


@pytest.mark.parametrize("log", ["linlog", "log_eps", "ln"])
def test_the_log_is_the_pixels_own_with_the_knee_of_the_network(log: str) -> None:
    """The same bits as the native log map; the sensor's own map and knee are not asked."""
    sensor = SensorParameters(
        "test", 9, 4, 0.2, 0.2, exposure_dn=200.0, dark_lux=2.0, white_lux=255.0, log=log,
        linlog_dn=20.0,
    )  # fmt: skip
    weights = through_network()
    same = SensorParameters(
        "test", 9, 4, 0.2, 0.2, exposure_dn=200.0, dark_lux=2.0, white_lux=255.0,
        linlog_dn=weights.linlog_dn,
    )  # fmt: skip
    rng = np.random.default_rng(1)
    film = np.exp(rng.normal(-4, 4, (6, 4, 9))).astype(np.float32)
    state = dark()
    x = LogDelta.of(sensor, weights).step(film, state)
    logs = log_light(film, same)
    assert x.dtype == np.float32
    assert not np.any(x[0])
    assert x[1:].tobytes() == (logs[1:] - logs[:-1]).tobytes()
    assert state.last_log.tobytes() == logs[-1].tobytes()
    assert state.last_luminance.tobytes() == film[-1].tobytes()
    assert (state.clamped, state.x_clamped) == (0, 0)


def test_log_of_the_paper() -> None:
    """ln L from rho on, (ln rho / rho) L below, in DN."""
    x, _ = steps_of([10 / 255, 20 / 255, 1 / 255, 0.0])
    rho = math.e
    assert x[1] == pytest.approx(math.log(2.0), rel=1e-5)
    assert x[2] == pytest.approx(math.log(rho) / rho - math.log(20.0), rel=1e-5)
    assert x[3] == pytest.approx(-math.log(rho) / rho, rel=1e-5)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, -1.0, -1e-18, 2e36])
def test_no_light_is_the_last_light(bad: float) -> None:
    x, state = steps_of([1.0, bad, bad, 2.0, bad, 2.0])
    good, _ = steps_of([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    assert x.tobytes() == good.tobytes()
    assert state.clamped == 3
    assert float(state.last_luminance[0, 0]) == 2.0


def test_the_first_light_only_sets_the_log() -> None:
    x, state = steps_of([math.nan, -1.0, 5.0, 5.0, 10.0])
    assert x[:4].tolist() == [0, 0, 0, 0]
    assert x[4] == pytest.approx(math.log(2.0), rel=1e-5)
    assert state.clamped == 2
    _, never = steps_of([math.nan] * 3)
    assert np.isnan(never.last_log[0, 0])
    assert never.last_luminance[0, 0] == -1


def test_black_is_light() -> None:
    x, state = steps_of([0.0, -0.0, 1e-30, -1e-30, 0.0])
    assert not np.any(x)
    assert state.clamped == 0


def test_steps_over_20_are_clamped_and_counted() -> None:
    x, state = steps_of([0.0, 1e9, 0.0, 1e35, 1e35])
    assert x.tolist() == pytest.approx([0.0, 20.0, -20.0, 20.0, 0.0], abs=1e-6)
    assert state.x_clamped == 3
    # the log itself is not clamped: after the sun the next change is of the real light
    x, _ = steps_of([0.0, 1e35, 2e35])
    assert x[2] == pytest.approx(math.log(2.0), rel=1e-4)


def test_the_light_handed_in_is_left_alone() -> None:
    film = np.full((2, 4, 9), np.nan, np.float32)
    film[0] = 1.0
    film.flags.writeable = False
    x = LogDelta.of(SENSOR, through_network()).step(film, dark())
    assert not np.any(x)
