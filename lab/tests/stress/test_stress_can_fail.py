"""Extremes of sensor, network and machine with something broken: each sees it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evs.drivers import clock
from evs.drivers.run import statistics
from evs.drivers.run.pace_monitor import PaceMonitor
from evs.emulator.evsnet import native
from evs.emulator.evsnet.bilif import Decay, decay_tables
from evs.emulator.sensor import pixel
from evs.emulator.sensor.readout import ReadoutState
from evs.msgs import Events
from evs_lab.stress import CaseResult, cases_of, machine, network, run_case
from evs_lab.stress.child_process import ProcessResult

# what the extremes see is tried by running them
pytestmark = pytest.mark.slow

Patch = pytest.MonkeyPatch


def tried(name: str) -> CaseResult:
    """The short form of an extreme."""
    groups = ("sensor", "network", "machine")
    (case,) = (one for group in groups for one in cases_of(group) if one.name == name)
    return run_case(case, short=True)


def test_whole_they_hold() -> None:
    for name in (
        "threshold-10", "sigma-over-theta", "refractory-beyond-run", "cutoff-0.01-hz", "size-1x1",
        "cutoff-1-mhz", "every-pixel-every-tick", "tau-shortest", "tau-longest", "weights-0",
        "quiet-1e9-ticks", "x-at-its-clamp", "weights-1e6", "evsnet-4096x4096", "clock-jumps",
    ):  # fmt: skip
        assert tried(name).holds, tried(name)


def changed(patch: Patch, change: Callable[[Events], Events]) -> None:
    """Events of every tick as `change` makes them."""
    step = pixel.PlainModel.step

    def wrong(self: pixel.PlainModel, *args: Any) -> tuple[Events, Any]:
        events, state = step(self, *args)
        return change(events), state

    patch.setattr(pixel.PlainModel, "step", wrong)


@pytest.mark.parametrize(
    "name",
    [
        "threshold-0.001", "threshold-10", "sigma-over-theta", "size-1x1", "size-1x4096",
        "size-4096x4096",
    ],
)  # fmt: skip
def test_events_that_are_lost(name: str, monkeypatch: Patch) -> None:
    changed(monkeypatch, lambda events: events[: len(events) // 2])
    found = tried(name)
    assert found.measurement is not None
    assert not found.holds
    assert not found.measurement.value <= found.measurement.limit


def test_events_that_are_late(monkeypatch: Patch) -> None:
    def late(events: Events) -> Events:
        delayed = events.copy()
        delayed["t"] += 0 if len(events) < 2 else np.minimum(9, events["t"][-1] - events["t"])
        return delayed

    step = pixel.PlainModel.step

    def wrong(self: pixel.PlainModel, *args: Any) -> tuple[Events, Any]:
        events, state = step(self, *args)
        return late(events) if self.sensor.cutoff_hz else events, state

    monkeypatch.setattr(pixel.PlainModel, "step", wrong)
    assert not tried("cutoff-1-mhz").holds


def test_pixels_that_are_not_blind(monkeypatch: Patch) -> None:
    changed(monkeypatch, lambda events: np.repeat(events, 2))
    found = tried("refractory-beyond-run")
    assert found.measurement is not None
    assert found.measurement.value == 2


@pytest.mark.parametrize("name", ["sigma-over-theta", "refractory-beyond-run", "cutoff-0.01-hz"])
def test_settings_that_nobody_is_warned_of(name: str, monkeypatch: Patch) -> None:
    monkeypatch.setattr(statistics, "lint", lambda *_: [])
    found = tried(name)
    assert found.measurement is not None
    assert not found.measurement.recovered


def test_drops_that_are_not_counted(monkeypatch: Patch) -> None:
    monkeypatch.setattr(ReadoutState, "dropped", property(lambda _state: {"busy": 1}))
    found = tried("every-pixel-every-tick")
    assert found.measurement is not None
    assert found.measurement.value > 1000


def test_a_network_that_is_not_refused_in_time(monkeypatch: Patch) -> None:
    monkeypatch.setattr(native, "check_growth", lambda *_of: None)
    assert not tried("evsnet-4096x4096").holds


@pytest.mark.parametrize("name", ["tau-longest", "quiet-1e9-ticks"])
def test_a_membrane_that_decays_a_little_too_fast(name: str, monkeypatch: Patch) -> None:
    def fast(tau_s: float, tick_us: int) -> Decay:
        exact = decay_tables(tau_s, tick_us)
        low, high = (table * np.float32(1 - 1e-6) for table in (exact.low, exact.high))
        return Decay(low.astype(np.float32), high.astype(np.float32))

    monkeypatch.setattr(native, "decay_tables", fast)
    short = tried(name)
    if name == "tau-longest":
        assert not short.holds
    else:  # nothing is left of it after 1e9 ticks; at full length shorter waits are looked at
        (case,) = (one for one in cases_of("network") if one.name == name)
        assert not run_case(case).holds


def test_a_decay_that_is_no_number(monkeypatch: Patch) -> None:
    def none(tau_s: float, tick_us: int) -> Decay:
        exact = decay_tables(tau_s, tick_us)
        return Decay(exact.low * np.float32(math.nan), exact.high)

    monkeypatch.setattr(native, "decay_tables", none)
    assert not tried("tau-shortest").holds


def test_weights_that_are_not_zero(monkeypatch: Patch) -> None:
    scaled = network.scaled
    monkeypatch.setattr(network, "scaled", lambda _by, *of: scaled(1.0, *of))
    assert not tried("weights-0").holds


@pytest.mark.parametrize("name", ["x-at-its-clamp", "weights-1e6"])
def test_clamps_that_nobody_is_told_of(name: str, monkeypatch: Patch) -> None:
    monkeypatch.setattr(statistics.RunStatistics, "new_warnings", lambda _statistics: [])
    assert not tried(name).holds


def test_a_clock_that_is_waited_for_or_not_told_of(monkeypatch: Patch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(clock, "_CLOCK_STEP_S", math.inf)
        found = tried("clock-jumps")
        assert found.measurement is not None
        assert found.measurement.value > 1e6
    monkeypatch.setattr(PaceMonitor, "update", lambda _monitor: None)
    assert not tried("clock-jumps").holds


def test_time_that_is_stolen_and_not_told_of(monkeypatch: Patch) -> None:
    monkeypatch.setattr(PaceMonitor, "_warn_of_slip", lambda _monitor: None)
    assert not tried("stolen-time").holds


@pytest.mark.parametrize("name", ["memory-limit", "disk-full"])
def test_a_recording_that_lacks_an_event(name: str, monkeypatch: Patch) -> None:
    emulate = machine.emulate

    def lossy(*words: Any, **more: Any) -> ProcessResult:
        ended = emulate(*words, **more)
        return replace(ended, recorded=ended.recorded[:-1])

    monkeypatch.setattr(machine, "emulate", lossy)
    found = tried(name)
    assert found.measurement is not None
    assert found.measurement.value >= 1


def test_a_path_without_avx_that_makes_other_events(monkeypatch: Patch) -> None:
    emulate = machine.emulate

    def other(*words: Any, **more: Any) -> ProcessResult:
        ended = emulate(*words, **more)
        return replace(ended, recorded=ended.recorded[::2])

    monkeypatch.setattr(machine, "emulate", other)
    found = tried("no-avx")
    assert found.measurement is not None
    assert found.measurement.value > 10


def test_a_thread_that_makes_other_events(monkeypatch: Patch) -> None:
    step = pixel.PlainModel.step

    def wrong(self: pixel.PlainModel, *args: Any) -> tuple[Events, Any]:
        events, state = step(self, *args)
        return events if self._threads == 1 else events[::2], state

    monkeypatch.setattr(pixel.PlainModel, "step", wrong)
    found = tried("threads")
    assert found.measurement is not None
    assert found.measurement.value > 100
