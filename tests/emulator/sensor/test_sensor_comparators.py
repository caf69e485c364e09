"""The order of crossings, noise and blindness in a tick: every small case, told microsecond by
microsecond in whole numbers."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest

from evs.emulator.sensor import PlainModel, PlainState, SensorParameters
from evs.msgs import Cause
from reference.pixel.comparators import PixelTick, compare
from reference.pixel.noise import Candidate

TICK_US = 8
ON, OFF = 16, 24
"""Thresholds; all log units of this file are 1 / 64, so that a tick's eighths are whole."""


@dataclass
class Told:
    """A pixel as an observer with a microsecond's patience sees it; whole numbers only."""

    reference: int | None
    """None: blind"""
    wake_us: int
    events: list[tuple[int, int, int]]


def tell(
    reference: int | None, wake_us: int, span: int, drift: int, refractory_us: int, shots: list[int]
) -> Told:
    """Signal from 0 to span; noise is always ON; `reference` as it would be at the start."""
    pixel = Told(reference, wake_us, [])
    moving = Cause.LEAK if abs(drift) > abs(span) else Cause.SIGNAL

    def fire(t: int, polarity: int, cause: Cause, level: int) -> None:
        pixel.events.append((t, polarity, cause))
        pixel.reference = level
        if refractory_us:
            pixel.reference, pixel.wake_us = None, t + refractory_us

    for t in range(1, TICK_US + 1):
        apart = (span + drift) * t // TICK_US
        assert apart * TICK_US == (span + drift) * t
        if pixel.reference is None and pixel.wake_us == t:
            pixel.reference = apart
        while pixel.reference is not None and apart >= pixel.reference + ON:
            fire(t, 1, moving, pixel.reference + ON)
        while pixel.reference is not None and apart <= pixel.reference - OFF:
            fire(t, 0, moving, pixel.reference - OFF)
        if t in shots and pixel.reference is not None:
            fire(t, 1, Cause.SHOT, apart)
    return pixel


def test_every_small_case() -> None:
    cases = 0
    for reference, wake_us, span, drift, refractory_us in itertools.product(
        (None, -15, 0, 8, 23), (1, 3, 8, 11), range(-96, 97, 24), (0, 16, 40), (0, 1, 3, 20)
    ):
        if reference is not None and wake_us != 1:
            continue
        for first, second in itertools.combinations_with_replacement((0, 1, 3, 4, 8), 2):
            shots = [t for t in (first, second) if t]
            if len(set(shots)) != len(shots):
                continue
            told = tell(reference, wake_us, span, drift, refractory_us, shots)
            happened, r, blind_until = compare(
                PixelTick(
                    on=ON / 64,
                    off=OFF / 64,
                    reference=math.nan if reference is None else reference / 64,
                    blind_until_us=1000 + wake_us,
                    signal=0.0,
                    signal_end=span / 64,
                    drift=drift / 64,
                    begin_us=1000,
                    tick_us=TICK_US,
                    refractory_us=refractory_us,
                    shots=tuple(Candidate(0, t, 0.0) for t in shots),
                    shot_on_hz=1.0,
                    shot_hz=1.0,
                )
            )
            assert [(e.offset_us, e.polarity, e.cause) for e in happened] == told.events
            if told.reference is None:
                assert math.isnan(r)
                assert blind_until == 1000 + told.wake_us
            else:
                assert r == (told.reference - drift) / 64
            cases += 1
    assert cases > 9000


def crowd(**terms: float) -> SensorParameters:
    return SensorParameters("crowd", 32, 32, 0.05, 0.06, 0.01, **terms)  # type: ignore[arg-type]


@pytest.mark.parametrize("refractory_us", [1, 7, 200])
def test_nobody_fires_while_blind_and_noise_may_come_in_the_us_it_ends(refractory_us: int) -> None:
    """Native, with so much of everything that all coincidences occur."""
    sensor = crowd(
        refractory_period_s=refractory_us * 1e-6, shot_noise_rate_hz=1e5, leak_rate_hz=1e4
    )
    events, causes = run(sensor, 100)
    same = np.diff(events["y"] * 32 + events["x"]) == 0
    waits = np.diff(events["t"])[same]
    assert len(waits) > 10_000
    assert waits.min() == refractory_us
    ended = same & (np.diff(events["t"]) == refractory_us)
    assert np.count_nonzero(causes[1:][ended] == Cause.SHOT) > 10


@pytest.mark.slow
def test_a_level_comes_before_noise_of_the_same_us() -> None:
    """Unless blind, a pixel may have both; the noise then has the last word on its reference."""
    events, causes = run(crowd(shot_noise_rate_hz=1e5, leak_rate_hz=1e4), 400)
    pixel = events["y"] * 32 + events["x"]
    both = (np.diff(pixel) == 0) & (np.diff(events["t"]) == 0) & (np.diff(causes.astype(int)) != 0)
    assert np.count_nonzero(both) > 10
    assert np.all(causes[:-1][both] == Cause.LEAK)
    assert np.all(causes[1:][both] == Cause.SHOT)


def run(sensor: SensorParameters, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Still light. Out: events pixel by pixel in order of time, and their causes."""
    model = PlainModel(sensor, 1, causes=True)
    state: PlainState = model.init(3)
    parts, why = [], []
    light = np.full((32, 32), 0.01, np.float32)
    for k in range(ticks):
        events, state = model.step(light, state, k * 50, (k + 1) * 50)
        parts.append(events[["t", "x", "y"]].tolist())
        why.append(events.view(np.uint8).reshape(-1, 16)[:, 13].copy())
    rows = np.array(
        [row for part in parts for row in part], dtype=[("t", "i8"), ("x", "i8"), ("y", "i8")]
    )
    causes = np.concatenate(why)
    order = np.lexsort((np.arange(len(rows)), rows["y"] * 32 + rows["x"]))
    return rows[order], causes[order]
