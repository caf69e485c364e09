"""The extremes of the network: its membrane's memory, its clamps, its weights."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from evs.drivers.extremes.curtain import OPEN, SHUT, Shown, curtain
from evs.drivers.extremes.extreme import Extreme, Outcome
from evs.drivers.extremes.film import Act
from evs.drivers.training.export import export
from evs.emulator import World
from evs.emulator.network.bilif import MAX_POTENTIAL
from evs.emulator.network.weights import Block, Convolution, NetworkWeights
from evs.emulator.saving import pack, unpack
from evs.emulator.scene import F32, F64
from evs.msgs import EvsError

LONGEST_TAU_S = 15.1
"""at a tick of 1 ms: the decay's tables end 2^20 ticks on, where 2^-100 must be left at most"""
STEP = math.log(255.0)
"""log contrast of the curtain, white to black"""
SENSOR = {"width": 16, "height": 12, "pos_thres": 0.2, "neg_thres": 0.2}
"""[sensor]: thresholds as the network's own, so that V_on = V_off = 1"""
ROUNDINGS = 4.5
"""of 2^-24: two of the tables, two of the products, and half a one of the sum"""


def through(gain: float, tau_s: float = 0.5, blocks: int = 0) -> NetworkWeights:
    """A network whose current is gain X: X and -X go through as two channels."""

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
    """A network all of whose weights are this one."""

    def flat(inputs: int) -> Convolution:
        return Convolution(np.full((channels, inputs, 7), weight, np.float32))

    pair = Block(flat(channels), flat(channels))
    last = np.full(channels, weight, np.float32)
    return NetworkWeights("scaled", flat(1), (pair,) * blocks, last)


def shown(
    network: NetworkWeights,
    left: Callable[[int], float],
    ticks: int,
    watch: Act | None = None,
    exposure_dn: float = 255.0,
) -> Shown:
    """What the network makes of the curtain, read from its file; every membrane begins at 0."""
    with tempfile.TemporaryDirectory() as folder:
        path, _ = export(network, Path(folder) / "net.onnx")
        model = {"name": "evsnet", "network": str(path), "initial_state": "zero"}
        sensor = {**SENSOR, "exposure_dn": exposure_dn}
        return curtain(left, ticks, {"sensor": sensor, "model": model}, watch=watch)


def membranes(world: World) -> F32:
    """(h, w) V of its one camera, each as of the pixel's last active tick."""
    return np.array(world.cameras[0].save()["pixels.state.v"], np.float32)


def later(world: World, ticks: int) -> None:
    """The world with a network that has lived so many quiet ticks more, by its saved state."""
    about, arrays = unpack(world.save())
    name = "cameras.0.pixels.state.ticks"
    arrays[name] = np.array(int(arrays[name]) + ticks, np.int64)
    world.restore(pack(about, arrays))


def _forgetful(short: bool) -> Outcome:
    """A membrane that forgets all within a tick: it fires where one step alone is enough."""
    ticks = 40 if short else 400
    wrong, clamps = 0, 0
    for tau_s, enough, each in ((1e-6, 1.1, 1), (1e-6, 0.9, 0), (1e-300, 1.1, 1)):
        network = through(enough / STEP, tau_s)
        seen = shown(network, lambda tick: SHUT if tick % 2 else OPEN, ticks)
        on, off = seen.counts()
        wrong += int(np.abs(on + off - each * (ticks - 1)).sum())
        clamps += seen.film.report.clamps
    return Outcome(wrong, 0, "wrong events", (f"{clamps} values clamped",))


def _left_over(tau_s: float, quiet: int, real: bool = False) -> tuple[F32, F64]:
    """V after a step of 0.9 down, so many quiet ticks and the same step up; and by the closed form.

    In: real, whether these ticks are run, or the network's clock is put forward.
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

    seen = shown(through(0.9 / STEP, tau_s), left, ticks + 1, watch)
    if len(seen.film.events):
        raise EvsError("a step of 0.9 thresholds had an event")
    exact = before[0].astype(np.float64)
    waited_s = (quiet + 1) * 1e-3
    return membranes(seen.film.world), exact * (math.exp(-waited_s / tau_s) - 1.0)


def _waits(tau_s: float, waits: tuple[int, ...]) -> float:
    """By how many roundings of float32 V is off at most."""
    pairs = [_left_over(tau_s, quiet) for quiet in waits]
    return max(float(np.abs(v - exact).max()) for v, exact in pairs) * 2.0**24


def _long_memory(short: bool) -> Outcome:
    """The longest time constant there is; and one that is longer."""
    waits = (1000, 10**6) if short else (0, 255, 256, 1000, 10**4, 10**5, 10**6, 2**20)
    off_by = _waits(LONGEST_TAU_S, waits)
    refusal = refused(lambda: shown(through(1.0, 1.01 * LONGEST_TAU_S), lambda _tick: OPEN, 2))
    named = "tau_s is 15.251" in refusal and "15.1 s" in refusal
    return Outcome(off_by, ROUNDINGS, "roundings", (refusal,), named)


def _quiet(short: bool) -> Outcome:
    """A billion ticks in which nothing moves: 11.6 days."""
    off_by = _waits(0.5, (10**9,) if short else tuple(10**k for k in range(10)))
    # ticks that are run leave the same bits as a clock that is put forward
    count = 200 if short else 5000
    ran, put = (_left_over(0.5, count, real)[0] for real in (True, False))
    return Outcome(off_by, ROUNDINGS, "roundings", ("no event",), ran.tobytes() == put.tobytes())


def refused(attempt: Callable[[], object]) -> str:
    """The line of its EvsError; empty where there is none, or where it has several lines."""
    try:
        attempt()
    except EvsError as error:
        return "" if "\n" in str(error) else str(error)
    return ""


def _strobe(network: NetworkWeights, flashes: int, exposure_dn: float) -> Outcome:
    """Black and white in turn, tick by tick, then stillness: how large a membrane gets."""
    still = int(MAX_POTENTIAL) + network.receptive_field + 8
    largest: list[float] = []

    def watch(_tick: int, world: World) -> None:
        largest.append(float(np.abs(membranes(world)).max()))

    def left(tick: int) -> float:
        return SHUT if tick < flashes and tick % 2 else OPEN

    ticks = flashes + still
    seen = shown(network, left, ticks, watch, exposure_dn)
    fired = len(seen.film.events) > 0
    quiet = not len(seen.film.within((ticks - 8) * 1000, ticks * 1000))
    # one event a pixel and tick at most, and each impossible value is counted
    most = SENSOR["width"] * SENSOR["height"] * ticks
    clamps = seen.film.report.clamps
    told = any("clamps" in line for line in seen.film.warnings)
    said = (*seen.film.warnings, f"clamps: {clamps:,}")
    right = fired and quiet and told and clamps > 0 and len(seen.film.events) <= most
    return Outcome(max(largest), float(MAX_POTENTIAL), "V_th", said, right and largest[-1] < 1.0)


def _clamped(short: bool) -> Outcome:
    """Steps of 20.7 log units, each tick, for ever: X is cut at 20."""
    return _strobe(through(5.0, blocks=3), 100 if short else 5000, 1e9)


def _zeros(short: bool) -> Outcome:
    """Weights of zeros under a strobe."""
    flashes = 100 if short else 5000
    seen = shown(scaled(0.0, 8, 3), lambda tick: SHUT if tick % 2 else OPEN, flashes)
    rest = float(np.abs(membranes(seen.film.world)).max())
    said = (f"{seen.film.report.events} events, {seen.film.report.clamps} values clamped",)
    return Outcome(len(seen.film.events), 0, "events", said, rest == 0.0)


def _large(short: bool) -> Outcome:
    """Weights of a million: two of them bounded, all of a whole network refused."""
    refusal = refused(lambda: scaled(1e6, 8, 3))
    found = _strobe(scaled(1e6, 2, 1), 100 if short else 5000, 255.0)
    right = found.recovered and "its weights are so large" in refusal
    return Outcome(found.value, found.limit, found.unit, (*found.said, refusal), right)


_MEMBRANE = (
    "|V| never over 64, where it is cut; one event a pixel and tick; every cut value is counted; "
    "64 ticks and the network's window after the last change all is silent"
)

EXTREMES = (
    Extreme(
        "tau-shortest",
        "network",
        "time constants of 1e-6 and 1e-300 s, ticks of 1 ms, steps of 1.1 and of 0.9 thresholds",
        "an event for each step of 1.1, none for 0.9: e^-1000 is nothing",
        _forgetful,
    ),
    Extreme(
        "tau-longest",
        "network",
        "a time constant of 15.1 s, the longest for ticks of 1 ms, and waits up to 2^20 ticks",
        "V is V e^(-t / tau) but for 4.5 roundings of 2^-24; a longer tau is refused in a line",
        _long_memory,
    ),
    Extreme(
        "quiet-1e9-ticks",
        "network",
        "a billion quiet ticks (11.6 days) between two steps of light",
        "V is V e^(-t / tau) but for 4.5 roundings of 2^-24; ticks that are run leave the same "
        "bits as ticks that are skipped",
        _quiet,
    ),
    Extreme(
        "x-at-its-clamp",
        "network",
        "steps of 20.7 log units in every tick (cut at 20), current 100",
        _MEMBRANE,
        _clamped,
    ),
    Extreme("weights-0", "network", "weights of zeros under a strobe", "no event, V = 0", _zeros),
    Extreme(
        "weights-1e6",
        "network",
        "weights of a million under a strobe",
        f"{_MEMBRANE}; a network whose sums may pass 1e30 is refused in a line",
        _large,
    ),
)
