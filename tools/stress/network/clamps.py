"""Steps of light and weights that are out of every range, or nothing."""

from __future__ import annotations

import numpy as np

from evs.emulator import World
from evs.emulator.evsnet.bilif import MAX_POTENTIAL
from evs.emulator.evsnet.weights import NetworkWeights
from evs.tools.stress.network.known_networks import (
    SENSOR,
    capture_network,
    membranes,
    refused,
    scaled,
    through,
)
from evs.tools.stress.step_target import OPEN, SHUT
from evs.tools.stress.stress_case import Measurement, StressCase


def _strobe(network: NetworkWeights, flashes: int, exposure_dn: float) -> Measurement:
    """Black and white in turn, tick by tick, then stillness: how large a membrane gets."""
    still = int(MAX_POTENTIAL) + network.receptive_field + 8
    largest: list[float] = []

    def watch(_tick: int, world: World) -> None:
        largest.append(float(np.abs(membranes(world)).max()))

    def left(tick: int) -> float:
        return SHUT if tick < flashes and tick % 2 else OPEN

    ticks = flashes + still
    seen = capture_network(network, left, ticks, watch, exposure_dn)
    fired = len(seen.capture.events) > 0
    quiet = not len(seen.capture.within((ticks - 8) * 1000, ticks * 1000))
    # one event a pixel and tick at most, and each impossible value is counted
    most = SENSOR["width"] * SENSOR["height"] * ticks
    clamps = seen.capture.report.clamps
    warned = any("clamps" in line for line in seen.capture.warnings)
    messages = (*seen.capture.warnings, f"clamps: {clamps:,}")
    right = fired and quiet and warned and clamps > 0 and len(seen.capture.events) <= most
    return Measurement(
        max(largest), float(MAX_POTENTIAL), "V_th", messages, right and largest[-1] < 1.0
    )


def _clamped(short: bool) -> Measurement:
    """Steps of 20.7 log units, each tick, for ever: X is cut at 20."""
    return _strobe(through(5.0, blocks=3), 100 if short else 5000, 1e9)


def _zeros(short: bool) -> Measurement:
    """Weights of zeros under a strobe."""
    flashes = 100 if short else 5000
    seen = capture_network(scaled(0.0, 8, 3), lambda tick: SHUT if tick % 2 else OPEN, flashes)
    rest = float(np.abs(membranes(seen.capture.world)).max())
    messages = (
        f"{seen.capture.report.events} events, {seen.capture.report.clamps} values clamped",
    )
    return Measurement(len(seen.capture.events), 0, "events", messages, rest == 0.0)


def _large(short: bool) -> Measurement:
    """Weights of a million: two of them bounded, all of a whole network refused."""
    refusal = refused(lambda: scaled(1e6, 8, 3))
    found = _strobe(scaled(1e6, 2, 1), 100 if short else 5000, 255.0)
    right = found.recovered and "its weights are so large" in refusal
    return Measurement(found.value, found.limit, found.unit, (*found.messages, refusal), right)


_MEMBRANE = (
    "|V| never over 64, where it is cut; one event a pixel and tick; every cut value is counted; "
    "64 ticks and the network's window after the last change all is silent"
)

CASES = (
    StressCase(
        "x-at-its-clamp",
        "network",
        "steps of 20.7 log units in every tick (cut at 20), current 100",
        _MEMBRANE,
        _clamped,
    ),
    StressCase(
        "weights-0", "network", "weights of zeros under a strobe", "no event, V = 0", _zeros
    ),
    StressCase(
        "weights-1e6",
        "network",
        "weights of a million under a strobe",
        f"{_MEMBRANE}; a network whose sums may pass 1e30 is refused in a line",
        _large,
    ),
)
