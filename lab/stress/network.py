"""Stress cases of the network: how long it remembers, and inputs out of every range."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F32, F64
from evs.emulator.evsnet.bilif import MAX_POTENTIAL
from evs.emulator.evsnet.export import export
from evs.emulator.evsnet.weights import Block, Convolution, NetworkWeights
from evs.emulator.state import pack, unpack
from evs.msgs import EvsError
from evs_lab.stress.capture import Act
from evs_lab.stress.step_target import OPEN, SHUT, StepCapture, capture_step
from evs_lab.stress.stress_case import Measurement, StressCase

STEP = math.log(255.0)
"""log contrast of the step target, white to black"""
SENSOR = {"width": 16, "height": 12, "pos_thres": 0.2, "neg_thres": 0.2}
"""[sensor]: thresholds as the network's own, so that V_on = V_off = 1"""


def through(gain: float, tau_s: float = 0.5, blocks: int = 0) -> NetworkWeights:
    """A network whose current is gain X: X and -X pass through it as two channels."""

    def tap(weight: list[list[float]]) -> Convolution:
        filters = np.zeros((2, len(weight[0]), 7), np.float32)
        filters[:, :, 6] = weight
        return Convolution(filters)

    silent = tap([[0.0, 0.0], [0.0, 0.0]])
    return NetworkWeights(
        name="through",
        encoder=tap([[1.0], [-1.0]]),
        blocks=(Block(silent, silent),) * blocks,
        last=np.array([gain, -gain], np.float32),
        tau_s=tau_s,
    )


def scaled(weight: float, channels: int, blocks: int) -> NetworkWeights:
    """A network with one value for all its weights."""

    def flat(inputs: int) -> Convolution:
        return Convolution(np.full((channels, inputs, 7), weight, np.float32))

    pair = Block(flat(channels), flat(channels))
    last = np.full(channels, weight, np.float32)
    return NetworkWeights("scaled", flat(1), (pair,) * blocks, last)


def capture_network(
    network: NetworkWeights,
    left: Callable[[int], float],
    ticks: int,
    watch: Act | None = None,
    exposure_dn: float = 255.0,
) -> StepCapture:
    """Capture the step target with the network, read from its file; every membrane begins at 0."""
    with tempfile.TemporaryDirectory() as folder:
        path, _ = export(network, Path(folder) / "net.onnx")
        model = {"name": "evsnet", "network": str(path), "initial_state": "zero"}
        sensor = {**SENSOR, "exposure_dn": exposure_dn}
        return capture_step(left, ticks, {"sensor": sensor, "model": model}, watch=watch)


def membranes(world: World) -> F32:
    """V of its one camera, (h, w), each at the pixel's last active tick."""
    return np.array(world.cameras[0].save()["pixels.state.v"], np.float32)


def later(world: World, ticks: int) -> None:
    """Move the network's clock forward by so many quiet ticks, through the world's saved state."""
    about, arrays = unpack(world.save())
    name = "cameras.0.pixels.state.ticks"
    arrays[name] = np.array(int(arrays[name]) + ticks, np.int64)
    world.restore(pack(about, arrays))


def refused(attempt: Callable[[], object]) -> str:
    """The line of the EvsError of a call; empty without an error, or with several lines."""
    try:
        attempt()
    except EvsError as error:
        return "" if "\n" in str(error) else str(error)
    return ""


LONGEST_TAU_S = 15.1
"""at a tick of 1 ms: the decay's tables end 2^20 ticks on, where 2^-100 must be left at most"""
ROUNDINGS = 4.5
"""of 2^-24: two of the tables, two of the products, and half a one of the sum"""


def _forgetful(short: bool) -> Measurement:
    """A membrane that decays within a tick fires only where one step alone is enough."""
    ticks = 40 if short else 400
    wrong, clamps = 0, 0
    for tau_s, enough, each in ((1e-6, 1.1, 1), (1e-6, 0.9, 0), (1e-300, 1.1, 1)):
        network = through(enough / STEP, tau_s)
        seen = capture_network(network, lambda tick: SHUT if tick % 2 else OPEN, ticks)
        on, off = seen.counts()
        wrong += int(np.abs(on + off - each * (ticks - 1)).sum())
        clamps += seen.capture.report.clamps
    return Measurement(wrong, 0, "wrong events", (f"{clamps} values clamped",))


def _left_over(tau_s: float, quiet: int, real: bool = False) -> tuple[F32, F64]:
    """V after a step of 0.9 down, quiet ticks and the same step up; and by the closed form.

    Args:
        tau_s: time constant of the membrane.
        quiet: number of quiet ticks.
        real: whether these ticks are run, instead of moving the network's clock forward.
    """
    ticks = 2 + quiet if real else 2
    before: list[F32] = []

    def watch(tick: int, world: World) -> None:
        if tick == 2:
            before.append(membranes(world))
            if not real:
                later(world, quiet)

    def left(tick: int) -> float:
        return SHUT if 1 <= tick < ticks else OPEN

    seen = capture_network(through(0.9 / STEP, tau_s), left, ticks + 1, watch)
    if len(seen.capture.events):
        raise EvsError("a step of 0.9 thresholds had an event")
    exact = before[0].astype(np.float64)
    waited_s = (quiet + 1) * 1e-3
    return membranes(seen.capture.world), exact * (math.exp(-waited_s / tau_s) - 1.0)


def _waits(tau_s: float, waits: tuple[int, ...]) -> float:
    """Largest error of V, in roundings of float32."""
    pairs = [_left_over(tau_s, quiet) for quiet in waits]
    return max(float(np.abs(v - exact).max()) for v, exact in pairs) * 2.0**24


def _long_memory(short: bool) -> Measurement:
    """The longest time constant that is accepted; and one that is longer."""
    waits = (1000, 10**6) if short else (0, 255, 256, 1000, 10**4, 10**5, 10**6, 2**20)
    off_by = _waits(LONGEST_TAU_S, waits)
    refusal = refused(
        lambda: capture_network(through(1.0, 1.01 * LONGEST_TAU_S), lambda _tick: OPEN, 2)
    )
    named = "tau_s is 15.251" in refusal and "15.1 s" in refusal
    return Measurement(off_by, ROUNDINGS, "rounding errors", (refusal,), named)


def _quiet(short: bool) -> Measurement:
    """A billion ticks in which nothing moves: 11.6 days."""
    off_by = _waits(0.5, (10**9,) if short else tuple(10**k for k in range(10)))
    # ticks that are run leave the same bits as a clock that is moved forward
    count = 200 if short else 5000
    ran, put = (_left_over(0.5, count, real)[0] for real in (True, False))
    return Measurement(
        off_by, ROUNDINGS, "rounding errors", ("no events",), ran.tobytes() == put.tobytes()
    )


def _strobe(network: NetworkWeights, flashes: int, exposure_dn: float) -> Measurement:
    """Alternate black and white each tick, then rest: how large a membrane becomes."""
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
    # at most one event a pixel and tick, and each clipped value is counted
    most = SENSOR["width"] * SENSOR["height"] * ticks
    clamps = seen.capture.report.clamps
    warned = any("clamps" in line for line in seen.capture.warnings)
    messages = (*seen.capture.warnings, f"clamps: {clamps:,}")
    right = fired and quiet and warned and clamps > 0 and len(seen.capture.events) <= most
    return Measurement(
        max(largest), float(MAX_POTENTIAL), "V_th", messages, right and largest[-1] < 1.0
    )


def _clamped(short: bool) -> Measurement:
    """Steps of 20.7 log units in each tick; X is clipped at 20."""
    return _strobe(through(5.0, blocks=3), 100 if short else 5000, 1e9)


def _zeros(short: bool) -> Measurement:
    """Weights of zero under a strobe."""
    flashes = 100 if short else 5000
    seen = capture_network(scaled(0.0, 8, 3), lambda tick: SHUT if tick % 2 else OPEN, flashes)
    rest = float(np.abs(membranes(seen.capture.world)).max())
    messages = (
        f"{seen.capture.report.events} events, {seen.capture.report.clamps} values clamped",
    )
    return Measurement(len(seen.capture.events), 0, "events", messages, rest == 0.0)


def _large(short: bool) -> Measurement:
    """Weights of a million: a small network is clipped, a large one refused."""
    refusal = refused(lambda: scaled(1e6, 8, 3))
    found = _strobe(scaled(1e6, 2, 1), 100 if short else 5000, 255.0)
    right = found.recovered and "its weights are so large" in refusal
    return Measurement(found.value, found.limit, found.unit, (*found.messages, refusal), right)


_MEMBRANE = (
    "|V| stays within 64; at most one event per pixel and tick; every clamped value is counted; no "
    "events later than 64 ticks plus the network's window after the last change"
)

CASES = (
    StressCase(
        "tau-shortest",
        "network",
        "time constants of 1e-6 and 1e-300 s, ticks of 1 ms, light steps of 1.1 and 0.9 thresholds",
        "one event for each step of 1.1 and none for 0.9, because e^-1000 is zero",
        _forgetful,
    ),
    StressCase(
        "tau-longest",
        "network",
        "a time constant of 15.1 s, the longest for ticks of 1 ms, and waits of up to 2^20 ticks",
        "V becomes V e^(-t / tau) to within 4.5 rounding errors of 2^-24; a longer tau is rejected "
        "with a one-line message",
        _long_memory,
    ),
    StressCase(
        "quiet-1e9-ticks",
        "network",
        "a billion quiet ticks (11.6 days) between two light steps",
        "V becomes V e^(-t / tau) to within 4.5 rounding errors of 2^-24; executed ticks leave the "
        "same bits as skipped ticks",
        _quiet,
    ),
    StressCase(
        "x-at-its-clamp",
        "network",
        "a step of 20.7 log units in every tick (clamped at 20), with a current of 100",
        _MEMBRANE,
        _clamped,
    ),
    StressCase(
        "weights-0", "network", "all weights 0, in strobe light", "no events, V = 0", _zeros
    ),
    StressCase(
        "weights-1e6",
        "network",
        "all weights 1e6, in strobe light",
        f"{_MEMBRANE}; a network whose current may exceed 1e30 is rejected with a one-line message",
        _large,
    ),
)
