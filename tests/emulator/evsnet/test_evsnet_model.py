"""EvsNetModel: what it takes of a sensor, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.base import memory_limits
from evs.emulator.base.scene import F32
from evs.emulator.config import SensorConfig
from evs.emulator.evsnet import Block, NetworkWeights
from evs.emulator.evsnet.model import MAX_TIME_US, EvsNetModel
from evs.emulator.evsnet.state import MAX_TICKS, NetworkState, dense_bytes
from evs.emulator.sensor import PlainModel, SensorParameters, preset_names, resolve_sensor
from evs.msgs import EVENT_DTYPE, EvsError
from reference.networks import random_network, through_network

SENSOR = SensorParameters("test", 6, 3, 0.2, 0.25)
WEIGHTS = random_network(2, 4)


def model(
    sensor: SensorParameters = SENSOR, weights: NetworkWeights = WEIGHTS, **settings: object
) -> EvsNetModel:
    return EvsNetModel(sensor, weights, runtime="reference", **settings)  # type: ignore[arg-type]


def film(ticks: int = 30) -> F32:
    rng = np.random.default_rng(0)
    return np.exp(np.cumsum(rng.normal(0, 0.2, (ticks, 3, 6)), axis=0) - 1).astype(np.float32)


def run(model: EvsNetModel, light: F32) -> bytes:
    events, _ = model.step_chunk(light, model.init(0), 0, 1000)
    assert all(tick.dtype == EVENT_DTYPE for tick in events)
    return b"".join(tick.tobytes() for tick in events)


def refused(says: str, call: Callable[[], object]) -> None:
    with pytest.raises(EvsError) as error:
        call()
    assert str(error.value) == says


def test_step_is_a_chunk_of_one() -> None:
    one, state, parts = model(), model().init(0), []
    for k, frame in enumerate(film()):
        events, after = one.step(frame, state, k * 1000, (k + 1) * 1000)
        assert after is state
        assert np.all((events["t"] > k * 1000) & (events["t"] <= (k + 1) * 1000))
        parts.append(events.tobytes())
    assert b"".join(parts) == run(model(), film())


def test_no_ticks_are_no_events() -> None:
    state = model().init(0)
    kept = state.copy()
    assert model().step_chunk(film(0), state, 0, 1000) == ([], kept)


def test_thresholds_are_the_sensors() -> None:
    """The same light on a pixel of half the thresholds: twice the events, from the same network."""
    weights = through_network(5.0, tau_s=15.0)
    slope = np.exp(0.004 * np.arange(500)).astype(np.float32)
    light = np.broadcast_to(slope[:, np.newaxis, np.newaxis], (500, 3, 6))

    def count(pos_thres: float) -> int:
        return len(run(model(replace(SENSOR, pos_thres=pos_thres), weights), light)) // 16

    # 2 log units less what leaks of 500 ms at 15 s, of 18 pixels: within 1 event a pixel
    assert count(0.2) == pytest.approx(18 * 2 / 0.2, abs=18)
    assert count(0.1) == pytest.approx(18 * 2 / 0.1, abs=18)


def test_noise_and_bandwidth_of_a_preset_are_not_its_business() -> None:
    sensor = replace(
        SENSOR,
        sigma_thres=0.05,
        cutoff_hz=30.0,
        follower_hz=100.0,
        highpass_hz=1.0,
        leak_rate_hz=10.0,
        shot_noise_rate_hz=50.0,
        refractory_period_s=0.01,
        hot_leak_median_hz=0.5,
        dead_pixel_fraction=0.5,
        log="log_eps",
        filter="euler",
    )
    assert run(model(sensor), film()) == run(model(), film())
    # exposure and dark current are
    for change in ({"exposure_dn": 5.0}, {"dark_lux": 50.0}):
        assert run(model(replace(SENSOR, **change)), film()) != run(model(), film())


@pytest.mark.parametrize("preset", preset_names())
def test_every_preset_has_thresholds_that_a_network_takes(preset: str) -> None:
    sensor = replace(resolve_sensor(SensorConfig(preset=preset)), width=6, height=3)
    assert len(run(model(sensor), film(60))) > 0


def test_names_that_do_not_exist() -> None:
    refused(
        "no runtime 'nativ'; there is: native, onnxruntime, reference",
        lambda: EvsNetModel(SENSOR, WEIGHTS, runtime="nativ"),
    )
    refused("no initial state 'rest'; there is: zero, random", lambda: model(initial="rest"))
    refused(
        "provider 'cuda' is for runtime onnxruntime; runtime reference has none",
        lambda: model(provider="cuda"),
    )


def test_labels_are_refused() -> None:
    refused(
        "model evsnet cannot label its events; use model plain or adaptive, or model.labels=false",
        lambda: model(labels=True),
    )


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        ((2, 6), "luminance is (2, 6), the sensor (height, width) is (3, 6)"),
        ((6, 3), "luminance is (6, 3), the sensor (height, width) is (3, 6)"),
        ((3, 6, 3), "luminance is (3, 6, 3), the sensor (height, width) is (3, 6)"),
        ((), "luminance is (), the sensor (height, width) is (3, 6)"),
    ],
)
def test_light_of_another_shape(shape: tuple[int, ...], says: str) -> None:
    light = np.ones(shape, np.float32)
    refused(says, lambda: model().step(light, model().init(0), 0, 1000))


def test_ticks_of_another_length() -> None:
    says = "tick of 500 us; network 'random2' is for ticks of 1000 us"
    state = model().init(0)
    refused(says, lambda: model().step_chunk(film(2), state, 0, 500))
    _, state = model().step(film(1)[0], state, 0, 1000)
    refused(says, lambda: model().step(film(1)[0], state, 1000, 1500))
    for begin_us in (MAX_TIME_US, -MAX_TIME_US - 1):
        refused(
            f"tick at {begin_us} us is beyond {MAX_TIME_US} us",
            lambda begin_us=begin_us: model().step_chunk(film(1), state, begin_us, 1000),
        )


def test_the_first_tick_of_a_stream_may_have_any_length() -> None:
    """Before it, light stood still for ever: there is nothing that its length could change."""
    state, usual = model().init(0), model().init(0)
    _, state = model().step(film(1)[0], state, 999, 1000)
    _, usual = model().step(film(1)[0], usual, 0, 1000)
    assert state == usual


def test_states_of_something_else() -> None:
    def step(state: object) -> None:
        model().step_chunk(film(1), state, 0, 1000)  # type: ignore[arg-type]

    plain = PlainModel(SENSOR, 1).init(0)
    refused("state is a PlainState, not of model evsnet; call init again", lambda: step(plain))
    state = model().init(0)
    other = replace(state.copy(), runtime="native")
    refused(
        "state is of runtime native, the model's is reference; call init again", lambda: step(other)
    )
    other = model(weights=random_network(3, 4)).init(0)
    refused(
        f"state is of network {other.network}, the model's is {state.network}; call init again",
        lambda: step(other),
    )
    other = model(replace(SENSOR, width=7)).init(0)
    refused("state is (3, 7), the sensor is (3, 6); call init again", lambda: step(other))
    other = replace(state.copy(), ticks=MAX_TICKS)
    refused(f"state is {MAX_TICKS} ticks old, past its end; call init again", lambda: step(other))


def test_arrays_that_are_not_the_runtimes() -> None:
    def changed(name: str, array: np.ndarray | None) -> NetworkState:
        state = model().init(0)
        if array is None:
            del state.arrays[name]
        else:
            state.arrays[name] = array
        return state

    for state, says in (
        (changed("fifo3", None), "state of runtime reference lacks array 'fifo3'; call init again"),
        (
            changed("tiles", np.zeros(3)),
            "state of runtime reference has an unknown array 'tiles'; call init again",
        ),
        (
            changed("fifo1", np.zeros((4, 6, 17), np.float32)),
            "state of runtime reference: fifo1 is float32 (4, 6, 17), not float32 (4, 6, 18); "
            "call init again",
        ),
        (
            changed("fifo1", np.zeros((4, 6, 18))),
            "state of runtime reference: fifo1 is float64 (4, 6, 18), not float32 (4, 6, 18); "
            "call init again",
        ),
    ):
        refused(says, lambda state=state: model().step_chunk(film(1), state, 0, 1000))


def test_thresholds_out_of_reach() -> None:
    refused(
        "sensor.pos_thres is 7; network 'random2' was trained for 0.2: give 0.00313 ... 6.4",
        lambda: model(replace(SENSOR, pos_thres=7.0)),
    )
    with pytest.raises(EvsError, match=r"sensor\.neg_thres is 9; .* trained for 0\.2"):
        model(replace(SENSOR, neg_thres=9.0))
    for threshold in (1e-300, 1e300):
        with pytest.raises(EvsError, match=r"sensor\.pos_thres is 0\.2; .* trained for 1e"):
            model(weights=replace(WEIGHTS, threshold=threshold))
    with pytest.raises(
        EvsError, match=r"tau_s is 100; with ticks of 1000 us, it can be at most 15.1"
    ):
        model(weights=replace(WEIGHTS, tau_s=100.0))


def test_a_dense_state_that_does_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    large = replace(SENSOR, width=4096, height=4096)
    eight = random_network(1)
    assert dense_bytes(eight, 4096, 4096) == (20 + 4 * 7 * 49) * 4096**2
    monkeypatch.setattr("evs.emulator.evsnet.state.memory_gb", lambda: (20.0, 16.2))
    says = (
        "a dense 4096x4096 state of 8 channels needs 23.4 GB, but only 16.2 GB are free: use a "
        "smaller sensor, a network with fewer channels, or runtime native with a network without "
        "biases, which stores only the active pixels"
    )
    refused(says, lambda: model(large, eight))
    refused(says, lambda: EvsNetModel(large, eight, runtime="onnxruntime"))
    refused(says, lambda: EvsNetModel(large, eight, sparse=False))
    refused(says, lambda: EvsNetModel(large, random_network(1, biased=True)))
    monkeypatch.setattr("evs.emulator.evsnet.state.memory_gb", lambda: (40.0, 30.0))
    model(large, eight)


def test_what_could_move_at_most_is_no_reason_to_refuse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Native and without biases, only what moves has FIFOs."""
    monkeypatch.setattr("evs.emulator.evsnet.state.memory_gb", lambda: (1.0, 0.01))
    large = replace(SENSOR, width=1024, height=1024)
    state = EvsNetModel(large, random_network(1)).init(0)
    assert sum(array.nbytes for array in state.arrays.values()) < 30 * 1024**2


def test_memory_is_what_the_machine_says() -> None:
    total_gb, free_gb = memory_limits.memory_gb()
    assert 0 < free_gb <= total_gb


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"tick_us": 2**28}, "tick_us is 268435456"),
        ({"spp": (4, 1)}, r"spp is \(4, 1\)"),
        ({"spp": (0, 1)}, r"spp is \(0, 1\)"),
        ({"linlog_dn": 1.0}, "linlog_dn is 1.0"),
        ({"linlog_dn": float("inf")}, "linlog_dn is inf"),
        ({"linlog_dn": float("nan")}, "linlog_dn is nan"),
        ({"last": np.full(4, 1e29, np.float32)}, "a current may exceed 1e.30"),
        ({"last_bias": 1e31}, "a current may exceed 1e.30"),
    ],
)
def test_weights_without_sense(change: dict[str, object], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        replace(WEIGHTS, **change)  # type: ignore[arg-type]


def test_weights_that_could_overflow_on_the_way() -> None:
    """One layer of 1e20, the next of 1e-20: the current is small, but Inf - Inf would be a NaN."""
    block = WEIGHTS.blocks[0]
    large = replace(block.first, weight=block.first.weight * np.float32(1e30))
    small = replace(block.second, weight=block.second.weight * np.float32(1e-30))
    with pytest.raises(EvsError, match="a current may exceed"):
        replace(WEIGHTS, blocks=(Block(large, small), *WEIGHTS.blocks[1:]))
    # also past blocks that add nothing: 20 in two channels, times 1e29
    with pytest.raises(EvsError, match="a current may exceed"):
        through_network(1e29)
    huge = replace(block.first, weight=np.full_like(block.first.weight, 3e38))
    with pytest.raises(EvsError, match="a current may exceed"):
        replace(WEIGHTS, blocks=(Block(huge, huge),) * 8)
