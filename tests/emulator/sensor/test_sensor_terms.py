"""A term that is off costs nothing and draws nothing, and switching it on moves no other."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.base.features import FEATURES, UNFORCED, Switches
from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.fixed_pattern import FixedPattern, draw_pattern
from evs.emulator.sensor.terms import TERMS as DECLARED
from evs.msgs import Events
from reference.terms import STATE
from reference.terms import TERMS as OF_TERMS

pytestmark = pytest.mark.property

IDEAL = SensorParameters("ideal", 33, 6, 0.2, 0.25, dark_lux=0.1)
TERMS = {**OF_TERMS, "dead": {"dead_pixel_fraction": 0.1}}
PATTERN = {
    "leak": {"leak", "phase"},
    "parasitic_leak": {"leak", "parasitic", "phase"},
    "shot_noise": {"shot_on", "shot_off"},
    "refractory_spread": {"refractory_us"},
    "defects": {"leak", "phase", "hot"},
}
"""term -> the arrays of fixed pattern that it has"""


def sensor_with(names: set[str]) -> SensorParameters:
    return replace(IDEAL, **{k: v for name in names for k, v in TERMS[name].items()})


def pattern_arrays(pattern: FixedPattern) -> dict[str, np.ndarray]:
    named = {field.name: getattr(pattern, field.name) for field in fields(pattern)}
    return {name: array for name, array in named.items() if array is not None}


@pytest.mark.parametrize("name", TERMS)
def test_a_term_has_its_own_memory_only(name: str) -> None:
    sensor = sensor_with({name})
    always = {"reference", "last_log", "last_luminance"}
    assert PlainModel(sensor, 1).init(0).arrays().keys() == always | STATE.get(name, set())
    assert pattern_arrays(draw_pattern(sensor, 0)).keys() == {"on", "off"} | PATTERN.get(
        name, set()
    )


def test_declared_terms_are_code_paths_of_the_pixel() -> None:
    assert {*DECLARED} == {feature.name for feature in FEATURES if feature.stage == "sensor"}


def test_every_parameter_is_of_a_term_or_of_none() -> None:
    """A new parameter has to be entered above, or here."""
    of_terms = {key for values in TERMS.values() for key in values}
    of_none = {
        *("name", "width", "height", "pos_thres", "neg_thres"),
        *("aps", "imu", "readout", "latency_us", "latency_sigma_us"),  # stages of their own
        *("log", "linlog_dn", "log_eps", "exposure_dn", "white_lux", "dark_lux", "dim_lux"),
        "temperature_c",
        *("bright_lux", "filter", "shot_noise_bright", "shot_noise_law", "hot_leak_cov_decades"),
        "photon_noise_factor",
    }
    assert {field.name for field in fields(SensorParameters)} == of_terms | of_none


@pytest.mark.slow
@settings(max_examples=200)
@given(names=st.sets(st.sampled_from(list(TERMS))), seed=st.integers(0, 2**64 - 1))
def test_the_fixed_pattern_of_a_term_does_not_depend_on_the_others(
    names: set[str], seed: int
) -> None:
    """But thresholds scale leak and shot rates, and what a pixel is (hot, dead) scales all."""
    scale = names & {"threshold_spread", "rate_spread", "defects", "dead"}
    ours = pattern_arrays(draw_pattern(sensor_with(names), seed))
    for name in names - scale:
        alone = pattern_arrays(draw_pattern(sensor_with(scale | {name}), seed))
        if "defects" in names or name != "parasitic_leak":
            assert PATTERN.get(name, set()) <= ours.keys()
        for key in PATTERN.get(name, set()) - {"leak", "phase"}:
            assert ours[key].tobytes() == alone[key].tobytes()
    # where a pixel is neither, it is as if the defects were off
    plain = pattern_arrays(draw_pattern(sensor_with(names - {"defects", "dead"}), seed))
    usual = np.isfinite(ours["on"]) & (ours.get("hot", np.uint8(0)) == 0)
    for key, array in plain.items():
        if key == "leak" and "defects" in names:
            assert np.all(ours[key][usual] >= array[usual])  # the tail has no end
        else:
            assert np.array_equal(ours[key][usual], array[usual])


def light_of(ticks: int, seed: int) -> list[F32]:
    """Steps, and rests between them."""
    rng = np.random.default_rng(seed)
    light = np.exp(rng.normal(-2, 1, (IDEAL.height, IDEAL.width)))
    frames = []
    for _ in range(ticks):
        if rng.random() < 0.4:
            light = light * np.exp(
                rng.normal(0, 0.5, light.shape) * (rng.random(light.shape) < 0.3)
            )
        frames.append(light.astype(np.float32))
    return frames


def of_cause(cause: int, model: PlainModel, frames: list[F32], seed: int) -> list[Events]:
    """The events of a cause, tick by tick."""
    state, found = model.init(seed), []
    for k, frame in enumerate(frames):
        events, state = model.step(frame, state, k * 1000, (k + 1) * 1000)
        found.append(events[events.view(np.uint8).reshape(-1, 16)[:, 13] == cause])
    return found


@settings(max_examples=60)
@given(
    names=st.sets(st.sampled_from([name for name in TERMS if not name.startswith("refractory")])),
    seed=st.integers(0, 2**32 - 1),
)
def test_noise_comes_at_the_same_times_whatever_else_is_on(names: set[str], seed: int) -> None:
    """Every single event, of pixels that are never blind. Photon noise has the same cause."""
    # the terms that its rates follow from
    base = {"shot_noise"} | names & {"threshold_spread", "rate_spread", "dead"}
    frames = light_of(12, seed)
    alone, beside = (
        of_cause(3, PlainModel(sensor_with(terms), 1, causes=True), frames, seed)
        for terms in (base, base | names)
    )
    assert sum(map(len, alone)) > 50
    for ours, theirs in zip(alone, beside, strict=True):
        if "photon_noise" in names:
            assert {*ours.tolist()} <= {*theirs.tolist()}
            continue
        for field in ("t", "x", "y", "p"):
            assert np.array_equal(ours[field], theirs[field])


@pytest.mark.parametrize("leak_hz", [0.0, 2.0])
@pytest.mark.parametrize("name", [x.name for x in FEATURES if x.stage == "sensor" and not x.idle])
def test_idle_terms_change_no_byte_of_photon_noise(name: str, leak_hz: float) -> None:
    """Of pixels that move, and of still ones, whose noise goes on by itself."""
    sensor = replace(
        sensor_with({"photon_noise", "threshold_spread"}), photocurrent_pa=0.1, leak_rate_hz=leak_hz
    )
    frames = light_of(8, 1)
    streams = []
    for switches in (UNFORCED, Switches(on=frozenset({name}))):
        model = PlainModel(sensor, 1, causes=True, switches=switches)
        state, found = model.init(2), []
        for k, frame in enumerate([*frames, *[frames[-1]] * 30]):
            events, state = model.step(frame, state, k * 1000, (k + 1) * 1000)
            found.append(events.tobytes())
        streams.append(found)
    assert all(streams[0][-20:])
    assert streams[0] == streams[1]


@settings(max_examples=60)
@given(names=st.sets(st.sampled_from(list(TERMS))), seed=st.integers(0, 2**32 - 1))
def test_candidates_for_noise_are_the_same_in_any_light_and_ticks(
    names: set[str], seed: int
) -> None:
    names = names | {"shot_noise"}
    model = PlainModel(sensor_with(names), 1)
    clocks = []
    for ticks_us, frames in (
        ([1000] * 12, light_of(12, seed)),
        ([4000] * 3, light_of(3, seed + 1)),
    ):
        state, t_us = model.init(seed), 0
        for tick_us, frame in zip(ticks_us, frames, strict=True):
            _, state = model.step(frame, state, t_us, t_us + tick_us)
            t_us += tick_us
        assert state.shot_next is not None
        assert state.shot_count is not None
        clocks.append((state.shot_next.tolist(), state.shot_count.tolist()))
    assert clocks[0] == clocks[1]


@settings(max_examples=60)
@given(names=st.sets(st.sampled_from(list(TERMS))), seed=st.integers(0, 2**32 - 1))
def test_causes_are_only_there_when_asked_and_change_nothing(names: set[str], seed: int) -> None:
    sensor, frames = sensor_with(names), light_of(8, seed)
    silent, telling = PlainModel(sensor, 1), PlainModel(sensor, 1, causes=True)
    ours, theirs = silent.init(seed), telling.init(seed)
    for k, frame in enumerate(frames):
        a, ours = silent.step(frame, ours, k * 1000, (k + 1) * 1000)
        b, theirs = telling.step(frame, theirs, k * 1000, (k + 1) * 1000)
        raw, causes = (events.view(np.uint8).reshape(-1, 16).copy() for events in (a, b))
        assert not np.any(raw[:, 13:])
        possible = {1} | ({3} if names & {"shot_noise", "photon_noise"} else set())
        possible |= {4} if "defects" in names else set()
        if names & {"leak", "parasitic_leak", "high_pass", "defects"}:
            possible |= {2}
        assert set(causes[:, 13].tolist()) <= possible
        causes[:, 13] = 0
        assert raw.tobytes() == causes.tobytes()
    assert ours == theirs
