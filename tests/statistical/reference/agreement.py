"""How two runtimes of one network compare: currents, events, and which differences are ties."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.network.model import EvsNetModel
from evs.emulator.network.state import NetworkState
from evs.emulator.scene import F32
from evs.msgs import Events


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
    """pixels whose first unpaired event is none of a membrane within 1e-4 of a threshold"""
    stamp_error_us: int
    """largest difference of two stamps of a pair"""


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
    paired = sorted(first.keys() & second.keys())
    unpaired = sorted(first.keys() ^ second.keys())
    stamps = np.array([first[key] - second[key] for key in paired])
    near = _near_threshold(model, one.currents, seed)
    scale = np.maximum(1.0, np.max(np.abs(one.currents), axis=0))
    # what follows a tie at the same pixel follows from it
    earliest: dict[tuple[int, int], int] = {}
    for tick, y, x, _ in unpaired:
        earliest.setdefault((y, x), tick)
    untied = sum(not near[tick, y, x] for (y, x), tick in earliest.items())
    return Agreement(
        float(np.max(np.abs(one.currents - other.currents) / scale)),
        len(first),
        len(unpaired),
        untied,
        int(np.max(np.abs(stamps), initial=0)),
    )


def _keyed(events: list[Events]) -> dict[tuple[int, int, int, int], int]:
    """(tick, y, x, polarity) -> stamp."""
    found = {}
    for tick, some in enumerate(events):
        columns = (some[key].tolist() for key in ("y", "x", "p", "t"))
        found |= {(tick, y, x, p): t for y, x, p, t in zip(*columns, strict=True)}
    return found


def _near_threshold(model: EvsNetModel, currents: F32, seed: int) -> np.ndarray[Any, Any]:
    """(ticks, h, w) bool: |V'| within 1e-4 thresholds of firing, decayed tick by tick."""
    weights, sensor = model.weights, model.sensor
    on, off = sensor.pos_thres / weights.threshold, sensor.neg_thres / weights.threshold
    decay = np.exp(-1e-6 * weights.tick_us / weights.tau_s)
    v = model.init(seed).v.astype(np.float64)
    near = np.zeros(currents.shape, bool)
    for tick, current in enumerate(currents):
        v = np.clip(v * decay + current, -64, 64)
        near[tick] = np.minimum(np.abs(v - on), np.abs(v + off)) < 1e-4
        v = np.where(v >= on, v - on, np.where(v <= -off, v + off, v))
    return near
