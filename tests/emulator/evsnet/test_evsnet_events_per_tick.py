"""Networks whose pixels fire many events per tick, beside the paper's one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import EVENTS_PER_TICK, most_events
from evs.emulator.evsnet.export import export
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.network_files import read_network
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from evs.msgs import Events, EvsError
from reference.networks import STRANGE, through_network

WIDTH, HEIGHT = 23, 10
SENSOR = SensorParameters("test", WIDTH, HEIGHT, 0.2, 0.25)


def film(scale: float, ticks: int = 60, seed: int = 0) -> F32:
    """Light that walks in steps of that size, in log units, and stands still now and then."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, scale, (ticks, HEIGHT, WIDTH)) * (rng.random((ticks, 1, 1)) < 0.6)
    return np.exp(np.cumsum(steps, axis=0)).astype(np.float32)


def model(events_per_tick: str = "many", **options: object) -> EvsNetModel:
    """The current of a pixel is the change of its log light, in thresholds."""
    sensor = options.pop("sensor", SENSOR)
    return EvsNetModel(
        sensor,  # type: ignore[arg-type]
        through_network(5.0, tau_s=15.0),
        events_per_tick=events_per_tick,
        **options,  # type: ignore[arg-type]
    )


def stream(one: EvsNetModel, light: F32) -> tuple[list[Events], NetworkState]:
    return one.step_chunk(light, one.init(3), 0, 1000)


@pytest.mark.parametrize("events_per_tick", EVENTS_PER_TICK)
@pytest.mark.parametrize("isa", _core.isa_available())
@pytest.mark.parametrize("threshold", [0.2, 0.02])
def test_native_and_onnxruntime_are_the_reference_to_the_byte(
    events_per_tick: str, isa: str, threshold: float
) -> None:
    """A network that passes X through makes no rounding of its own: no event may differ."""
    light = film(0.7)
    light[30] = np.float32(1e-6)
    light[34, 3:6] = np.resize(np.array(STRANGE, np.float32), (3, WIDTH))
    sensor = SensorParameters("test", WIDTH, HEIGHT, threshold, 0.3)
    expected, state = stream(model(events_per_tick, runtime="reference", sensor=sensor), light)
    for other in (
        model(events_per_tick, isa=isa, sensor=sensor),
        model(events_per_tick, isa=isa, sensor=sensor, sparse=False),
        model(events_per_tick, runtime="onnxruntime", sensor=sensor),
    ):
        events, found = stream(other, light)
        assert [tick.tobytes() for tick in events] == [tick.tobytes() for tick in expected]
        for name in ("v", "last"):
            assert found.arrays[name].tobytes() == state.arrays[name].tobytes(), name
        assert found.v_clamped == state.v_clamped
    most = max(len(tick) for tick in expected) / (WIDTH * HEIGHT)
    assert most <= 1 if events_per_tick == "one" else most > 10


def test_both_are_the_same_bytes_where_no_tick_is_worth_two_events() -> None:
    light = film(0.05)
    one, many = (stream(model(name), light) for name in EVENTS_PER_TICK)
    assert sum(map(len, one[0])) > 200
    assert [tick.tobytes() for tick in one[0]] == [tick.tobytes() for tick in many[0]]
    assert one[1] == many[1]


def test_after_a_tick_no_membrane_is_at_a_threshold() -> None:
    one = model()
    state = one.init(3)
    for k, frame in enumerate(film(1.0)):
        events, state = one.step(frame, state, 1000 * k, 1000 * (k + 1))
        assert np.all((state.v < np.float32(1)) & (state.v > -np.float32(1.25)))
        order = np.lexsort((events["x"], events["y"], events["t"]))
        assert np.array_equal(order, np.arange(len(events)))
        assert np.all((events["t"] > 1000 * k) & (events["t"] <= 1000 * (k + 1)))


def test_a_state_may_go_on_with_the_other() -> None:
    """The membranes mean the same; what is left of a trail fires in one tick."""
    light = np.ones((20, HEIGHT, WIDTH), np.float32)
    light[5:] = np.exp(2.05)
    one, many = (model(name, initial="zero") for name in EVENTS_PER_TICK)
    events, state = one.step_chunk(light[:8], one.init(0), 0, 1000)
    assert [len(tick) for tick in events] == [0] * 5 + [WIDTH * HEIGHT] * 3
    events, state = many.step_chunk(light[8:], NetworkState.restore(state.save()), 8000, 1000)
    assert [len(tick) for tick in events] == [7 * WIDTH * HEIGHT] + [0] * 11


@pytest.mark.statistical
def test_stamps_spread_over_the_tick() -> None:
    """An edge of some ticks over pixels with random membranes: each tenth has about a tenth."""
    sensor = SensorParameters("test", 346, 26, 0.2, 0.2)
    edge = np.exp(np.clip(0.53 * np.arange(-3, 6), 0.0, 1.59))
    light = np.broadcast_to(edge[:, np.newaxis, np.newaxis], (9, 26, 346)).astype(np.float32)
    # 8,996 pixels, each of whose phases moves all of its events: five deviations of one of ten; by
    # the paper's rule, the first event of a large step comes early in its tick, the others do not
    deviation = np.sqrt(0.1 * 0.9 / (346 * 26))
    for name, bound in (("many", 5 * deviation), ("one", 0.03)):
        events = np.concatenate(stream(model(name, sensor=sensor), light)[0])
        shares = np.bincount((events["t"] - 1) % 1000 // 100, minlength=10) / len(events)
        assert np.all(np.abs(shares - 0.1) < bound), name


@pytest.mark.parametrize("trained", EVENTS_PER_TICK)
def test_a_network_fires_as_it_was_trained_unless_told(trained: str, tmp_path: Path) -> None:
    weights = replace(through_network(5.0, tau_s=15.0), events_per_tick=trained)
    export(weights, tmp_path / "mine.onnx")
    stored = read_network(tmp_path / "mine.onnx")
    assert EvsNetModel(SENSOR, stored).most_events == most_events(trained)
    for told in EVENTS_PER_TICK:
        assert EvsNetModel(SENSOR, stored, events_per_tick=told).most_events == most_events(told)


def test_an_unknown_number_is_refused() -> None:
    assert most_events("one") == 1
    assert most_events("many") == 64
    with pytest.raises(
        EvsError, match=r"^no number of events per tick 'mnay'; there is: many, one"
    ):
        model("mnay")
