"""How two runtimes of one network compare: currents, events, and which differences are ties."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet import reference
from evs.emulator.evsnet.bilif import BiLIF, decay_per_tick, decay_tables
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.state import NetworkState
from evs.msgs import Events

CLOSE = 1e-4
"""in thresholds: what differences of 1e-5 in the currents may add up to in a membrane"""


@dataclass(frozen=True)
class Run:
    """The output of one runtime for given light."""

    currents: F32
    """(ticks, h, w)"""
    events: list[Events]
    """one array per tick"""
    state: NetworkState
    largest: F32
    """(h, w): largest value in a layer of the pixel, as the reference has it; 1 elsewhere"""


@dataclass(frozen=True)
class Agreement:
    """How well two runs agree."""

    current_error: float
    """largest difference of two currents, in units of the pixel's largest value in a layer: they
    all are rounded, and large ones may cancel"""
    events: int
    unpaired: int
    """events of either run without one of the same pixel, tick and polarity in the other"""
    ties: int
    """pixels with such an event"""
    expected_ties: float
    """by the mean error of the membranes, and how often they are near a threshold"""
    untied: int
    """pixels whose first unpaired event is not at a membrane within CLOSE of a threshold"""
    misplaced: int
    """pairs at pixels without a tie before, whose stamps differ by over 1 us, that a difference of
    CLOSE in the membrane does not explain, nor what the differences of the currents have added up
    to: it shifts the time at which the threshold is reached, the more, the smaller the current, and
    the phase of a trail, round the tick"""


def run(model: EvsNetModel, light: F32, seed: int = 1, cut: int = 16) -> Run:
    """Run the model on all of the light, `cut` ticks at a time."""
    state = model.init(seed)
    currents = np.empty(light.shape, np.float32)
    largest = np.ones(light[0].size, np.float32)
    events: list[Events] = []
    relu = reference.relu

    def watched(value: F32) -> F32:
        np.maximum(largest, np.max(np.abs(value), axis=(0, 1)), out=largest)
        return relu(value)

    with patch.object(reference, "relu", watched):
        for first in range(0, len(light), cut):
            chunk = np.ascontiguousarray(light[first : first + cut])
            out = np.empty(chunk.shape, np.float32)
            events += model.runtime.step(chunk, state, first * model.weights.tick_us, out)
            currents[first : first + cut] = out
    return Run(currents, events, state, largest.reshape(light[0].shape))


def compare(model: EvsNetModel, one: Run, other: Run, seed: int = 1) -> Agreement:
    """Compare two runs on the same light.

    Args:
        model: The model whose thresholds and time constants both runs have.
        one: The run of the oracle.
        other: The run that is judged.
        seed: The seed of both runs.
    """
    first, second = _keyed(one.events), _keyed(other.events)
    unpaired = sorted(first.keys() ^ second.keys())
    near, trails = _near_threshold(model, one.currents, seed)
    tick_us = model.weights.tick_us
    least = min(model.sensor.pos_thres, model.sensor.neg_thres) / model.weights.threshold
    # whatever follows a tie at the same pixel is a consequence of it
    tied: dict[tuple[int, int], int] = {}
    for tick, y, x, *_ in unpaired:
        tied.setdefault((y, x), tick)
    untied = sum(not near[tick, y, x] for (y, x), tick in tied.items())
    apart = _membrane_error(model, one.currents, other.currents)
    misplaced = 0
    for key in first.keys() & second.keys():
        tick, y, x, *_ = key
        off_us = abs(first[key] - second[key])
        if off_us > 1 and tick < tied.get((y, x), len(one.currents)):
            reach = max(CLOSE, float(apart[tick, y, x]))
            if trails[tick, y, x]:
                misplaced += min(off_us, tick_us - off_us) > 1 + reach * tick_us / least
            else:
                charge = abs(float(one.currents[tick, y, x]))
                misplaced += off_us > 1 + reach * tick_us / charge
    error = float(np.max(np.abs(one.currents - other.currents) / one.largest))
    expected = float(near.sum() * apart.mean() / CLOSE)
    return Agreement(error, len(first), len(unpaired), len(tied), expected, untied, misplaced)


def _keyed(events: list[Events]) -> dict[tuple[int, int, int, int, int], int]:
    """Return (tick, y, x, polarity, number in the tick) -> stamp, us."""
    found: dict[tuple[int, int, int, int, int], int] = {}
    for tick, some in enumerate(events):
        seen: Counter[tuple[int, int, int]] = Counter()
        columns = (some[key].tolist() for key in ("y", "x", "p", "t"))
        for y, x, p, t in zip(*columns, strict=True):
            found[tick, y, x, p, seen[y, x, p]] = t
            seen[y, x, p] += 1
    return found


def _membrane_error(model: EvsNetModel, one: F32, other: F32) -> np.ndarray[Any, Any]:
    """What differences of currents add up to in membranes, behind the leak: (ticks, h, w)."""
    leak = decay_per_tick(model.weights.tau_s, model.weights.tick_us)
    held = np.zeros(one.shape[1:])
    apart = np.empty(one.shape)
    for tick, change in enumerate(one.astype(np.float64) - other):
        held = leak * held + change
        apart[tick] = np.abs(held)
    return apart


def _near_threshold(
    model: EvsNetModel, currents: F32, seed: int
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Where the oracle's own membrane is within CLOSE of another count, and where of a trail.

    Returns:
        (ticks, h, w) bool each; a trail is a membrane at its threshold before the tick.
    """
    weights, sensor = model.weights, model.sensor
    on, off = sensor.pos_thres / weights.threshold, sensor.neg_thres / weights.threshold
    decay = decay_tables(weights.tau_s, weights.tick_us)
    most = model.most_events
    unit = BiLIF(np.float32(on), np.float32(off), decay, most)
    state = model.init(seed)
    near, trails = np.zeros(currents.shape, bool), np.zeros(currents.shape, bool)
    for tick, current in enumerate(currents):
        before = decay(state.v.ravel(), tick - state.last.ravel()).reshape(current.shape)
        trails[tick] = (before >= on - CLOSE) | (before <= -off + CLOSE)
        v = before + current
        up, down = (np.clip(np.round(part), 1, most) for part in (v / on, -v / off))
        near[tick] = np.minimum(np.abs(v - up * on), np.abs(v + down * off)) < CLOSE
        unit.step(current, state.v, state.last, tick, 0, weights.tick_us)
    return near, trails
