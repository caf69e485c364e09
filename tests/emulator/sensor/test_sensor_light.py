"""Light, times and ticks at the end of their ranges."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, PlainState, SensorParameters
from evs.msgs import Events
from reference.pixel.model import ReferenceModel

pytestmark = pytest.mark.extremes

NO_LIGHT = [np.nan, -np.nan, np.inf, -np.inf, -1.0, -1e-18, -3e38, 3e38]


def sensor(
    width: int = 8, height: int = 8, theta: float = 0.2, sigma: float = 0.03
) -> SensorParameters:
    return SensorParameters("test", width, height, theta, theta, sigma)


def steps(
    model: PlainModel | ReferenceModel,
    state: PlainState,
    frames: list[F32],
    t_us: int,
    tick_us: int,
) -> tuple[list[Events], PlainState]:
    found = []
    for frame in frames:
        events, state = model.step(frame, state, t_us, t_us + tick_us)
        found.append(events)
        t_us += tick_us
    return found, state


def flat(value: float) -> F32:
    return np.full((8, 8), value, np.float32)


@pytest.mark.parametrize("bad", NO_LIGHT)
def test_no_light_keeps_the_last_value_and_is_counted(bad: float) -> None:
    model = PlainModel(sensor(), 1)
    spoilt = flat(0.5)
    spoilt[2, 3] = bad
    found, state = steps(model, model.init(0), [flat(0.5), spoilt, spoilt, flat(0.5)], 0, 1000)
    assert [len(events) for events in found] == [0, 0, 0, 0]
    assert state.clamped == 2
    # the pixel lives on as if nothing had been
    after, _ = steps(model, state, [flat(1.0)], 4000, 1000)
    clean = model.init(0)
    _, clean = steps(model, clean, [flat(0.5)] * 4, 0, 1000)
    expected, _ = steps(model, clean, [flat(1.0)], 4000, 1000)
    assert after[0].tobytes() == expected[0].tobytes()
    assert np.count_nonzero((after[0]["x"] == 3) & (after[0]["y"] == 2)) in (2, 3, 4)


@pytest.mark.parametrize("bad", NO_LIGHT)
def test_a_pixel_without_first_light_starts_when_it_gets_some(bad: float) -> None:
    model = PlainModel(sensor(), 1)
    spoilt = flat(0.5)
    spoilt[2, 3] = bad
    found, state = steps(model, model.init(0), [spoilt, spoilt, flat(0.5), flat(0.5)], 0, 1000)
    assert [len(events) for events in found] == [0, 0, 0, 0]
    assert state.clamped == 2
    assert np.all(np.isfinite(state.reference))
    (events,), _ = steps(model, state, [flat(1.0)], 4000, 1000)
    assert np.count_nonzero((events["x"] == 3) & (events["y"] == 2)) in (2, 3, 4)


def test_a_sensor_that_never_sees_light_stays_silent() -> None:
    model = PlainModel(sensor(), 1)
    found, state = steps(model, model.init(0), [flat(np.nan)] * 5, 0, 1000)
    assert not any(map(len, found))
    assert state.clamped == 5 * 64


def test_black_to_sun_and_back() -> None:
    """2,000 events a pixel and tick, as many down as up, the oracle's bytes."""
    pixel = SensorParameters("test", 8, 8, 0.01, 0.01, 0.0, log="log_eps", log_eps=1e-6)
    frames = [flat(0.0), flat(1e3), flat(0.0), flat(1e3)]
    model, oracle = PlainModel(pixel, 2), ReferenceModel(pixel)
    ours, state = steps(model, model.init(0), frames, 0, 1000)
    expected, other = steps(oracle, oracle.init(0), frames, 0, 1000)
    counts = [len(events) // 64 for events in ours]
    assert counts[0] == 0
    assert 2060 < counts[1] < 2080  # ln(1e9) / .01 = 2072
    assert counts[1] == counts[2] == counts[3]
    for a, b in zip(ours, expected, strict=True):
        assert a.tobytes() == b.tobytes()
    assert state == other


@pytest.mark.parametrize("t_us", [0, 2**31 - 500, 2**32 - 500, 2**53 - 500, 2**62, -(2**40)])
def test_time_is_exact_wherever_it_is(t_us: int) -> None:
    generator = np.random.default_rng(0)
    frames = [np.exp(generator.normal(0, 1, (8, 8))).astype(np.float32) for _ in range(4)]
    model = PlainModel(sensor(), 1)
    near, _ = steps(model, model.init(0), frames, 0, 1001)
    far, _ = steps(model, model.init(0), frames, t_us, 1001)
    assert sum(map(len, near)) > 500
    for a, b in zip(near, far, strict=True):
        assert np.array_equal(a["t"] + t_us, b["t"])
        assert np.array_equal(a["p"], b["p"])


@pytest.mark.parametrize("tick_us", [1, 2, 7, 999, 2047, 2048, 65_536, 2_000_000, 2**28 - 1])
def test_ticks_of_any_length(tick_us: int) -> None:
    generator = np.random.default_rng(1)
    frames = [np.exp(generator.normal(0, 1, (8, 8))).astype(np.float32) for _ in range(5)]
    model, oracle = PlainModel(sensor(), 2), ReferenceModel(sensor())
    ours, state = steps(model, model.init(0), frames, 5, tick_us)
    expected, other = steps(oracle, oracle.init(0), frames, 5, tick_us)
    assert sum(map(len, ours)) > 500
    for k, (a, b) in enumerate(zip(ours, expected, strict=True)):
        assert a.tobytes() == b.tobytes()
        assert np.all(np.diff(a["t"]) >= 0)
        assert np.all((a["t"] > 5 + k * tick_us) & (a["t"] <= 5 + (k + 1) * tick_us))
    assert state == other


def test_the_reference_does_not_drift() -> None:
    """After 20,000 ticks it is still first light + n theta_on - m theta_off, exactly."""
    model = PlainModel(sensor(sigma=0.05), 1)
    generator = np.random.default_rng(3)
    start = flat(0.3)
    _, state = model.step(start, model.init(9), -1000, 0)
    units = 2.0**32
    first = (state.reference * units).astype(np.int64)
    net = np.zeros((2, 8, 8), np.int64)
    for k in range(20_000):
        frame = np.exp(generator.normal(-1, 1, (8, 8))).astype(np.float32)
        events, state = model.step(frame, state, k * 1000, (k + 1) * 1000)
        np.add.at(net, (events["p"], events["y"], events["x"]), 1)
    assert net.sum() > 5_000_000
    theta = model.pattern(9)
    on, off = ((part.astype(np.float64) * units).astype(np.int64) for part in (theta.on, theta.off))
    assert np.array_equal(
        first + net[1] * on - net[0] * off, (state.reference * units).astype(np.int64)
    )


def test_the_largest_and_the_smallest_sensor() -> None:
    for width, height in ((1, 1), (8192, 1), (1, 8192)):
        model = PlainModel(sensor(width, height), 2)
        dark, light = (np.full((height, width), value, np.float32) for value in (0.2, 0.9))
        _, state = model.step(dark, model.init(0), -1000, 0)
        events, _ = model.step(light, state, 0, 1000)
        assert (events["x"].max(), events["y"].max()) == (width - 1, height - 1)
        assert len(events) > 4 * width * height
