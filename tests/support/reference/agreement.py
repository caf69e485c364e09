"""How two runtimes of one network compare: currents, events, and which differences are ties."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import BiLIF, decay_tables
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.state import NetworkState
from evs.msgs import Events

CLOSE = 1e-4
"""thresholds: what differences of 1e-5 of currents may add up to in a membrane"""


@dataclass(frozen=True)
class Run:
    """What one runtime makes of a light."""

    currents: F32
    """(ticks, h, w)"""
    events: list[Events]
    """one array a tick"""
    state: NetworkState


@dataclass(frozen=True)
class Agreement:
    """Of two runs."""

    current_error: float
    """largest difference of two currents, in units of the pixel's largest or of 1"""
    events: int
    unpaired: int
    """events of either run for which the other has none of that pixel, tick and polarity"""
    untied: int
    """pixels whose first unpaired event is none of a membrane within CLOSE of a threshold"""
    stamps_off: int
    """pairs whose stamps differ by more than 1 us, at pixels without a tie before"""
    misplaced: int
    """those that a membrane within CLOSE does not explain: it reaches a threshold at another time,
    the more so the smaller the current that carries it there"""


def run(model: EvsNetModel, light: F32, seed: int = 1, cut: int = 16) -> Run:
    """All of the light, `cut` ticks at a time."""
    state = model.init(seed)
    currents = np.empty(light.shape, np.float32)
    events: list[Events] = []
    for first in range(0, len(light), cut):
        chunk = np.ascontiguousarray(light[first : first + cut])
        out = np.empty(chunk.shape, np.float32)
        events += model.runtime.step(chunk, state, first * model.weights.tick_us, out)
        currents[first : first + cut] = out
    return Run(currents, events, state)


def compare(model: EvsNetModel, one: Run, other: Run, seed: int = 1) -> Agreement:
    """In: model, whose thresholds and tau both have; one, the oracle."""
    first, second = _keyed(one.events), _keyed(other.events)
    unpaired = sorted(first.keys() ^ second.keys())
    near = _near_threshold(model, one.currents, seed)
    scale = np.maximum(1.0, np.max(np.abs(one.currents), axis=0))
    # what follows a tie at the same pixel follows from it
    tied: dict[tuple[int, int], int] = {}
    for tick, y, x, _ in unpaired:
        tied.setdefault((y, x), tick)
    untied = sum(not near[tick, y, x] for (y, x), tick in tied.items())
    stamps_off = misplaced = 0
    for tick, y, x, p in first.keys() & second.keys():
        off_us = abs(first[tick, y, x, p] - second[tick, y, x, p])
        if off_us > 1 and tick < tied.get((y, x), len(one.currents)):
            stamps_off += 1
            charge = abs(float(one.currents[tick, y, x]))
            misplaced += off_us > 1 + CLOSE * model.weights.tick_us / charge
    error = float(np.max(np.abs(one.currents - other.currents) / scale))
    return Agreement(error, len(first), len(unpaired), untied, stamps_off, misplaced)


def _keyed(events: list[Events]) -> dict[tuple[int, int, int, int], int]:
    """(tick, y, x, polarity) -> stamp."""
    found = {}
    for tick, some in enumerate(events):
        columns = (some[key].tolist() for key in ("y", "x", "p", "t"))
        found |= {(tick, y, x, p): t for y, x, p, t in zip(*columns, strict=True)}
    return found


def _near_threshold(model: EvsNetModel, currents: F32, seed: int) -> np.ndarray[Any, Any]:
    """(ticks, h, w) bool: |V'| within CLOSE of a threshold, of the oracle's own membrane."""
    weights, sensor = model.weights, model.sensor
    on, off = sensor.pos_thres / weights.threshold, sensor.neg_thres / weights.threshold
    decay = decay_tables(weights.tau_s, weights.tick_us)
    unit = BiLIF(np.float32(on), np.float32(off), decay)
    state = model.init(seed)
    near = np.zeros(currents.shape, bool)
    for tick, current in enumerate(currents):
        v = decay(state.v.ravel(), tick - state.last.ravel()).reshape(current.shape) + current
        near[tick] = np.minimum(np.abs(v - on), np.abs(v + off)) < CLOSE
        unit.step(current, state.v, state.last, tick, 0, weights.tick_us)
    return near
