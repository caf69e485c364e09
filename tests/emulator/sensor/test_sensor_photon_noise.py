"""Photon noise: its events against simulated noise, ticks of any length, and published shapes.

Where a test says within so many percent, this is the error of the model; 3.3 standard errors of
what was measured come on top of it.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy

from evs.emulator import _core
from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.pixel import PlainState
from evs.msgs import Events, join_events
from reference.two_pole_noise import (
    WHITE_LUX,
    Estimate,
    NoiseStatistics,
    at_phase,
    native_events,
    noisy_sensor,
    random_phase,
    simulated_events,
)

pytestmark = pytest.mark.statistical

THETA = 0.2
POLES_HZ = [(30.0, 3000.0), (300.0, 3000.0), (300.0, 900.0)]
NOISES = [0.3, 0.5]
"""standard deviation of the noise, thresholds"""


def even(side: int, luminance: float = 1.0) -> F32:
    return np.full((side, side), luminance, np.float32)


def end_us(poles_hz: tuple[float, float]) -> int:
    return 200_000 if min(poles_hz) < 100 else 60_000


@functools.cache
def native(
    poles_hz: tuple[float, float], noise: float, tick_us: int, side: int, seed: int
) -> NoiseStatistics:
    sensor = noisy_sensor(poles_hz, noise * THETA, THETA, side)
    end = end_us(poles_hz)
    phase = random_phase(THETA, side, 1)
    events = native_events(sensor, even(side), phase, end, tick_us, seed)
    return NoiseStatistics.of(events, side, end)


@pytest.mark.slow
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("poles_hz", POLES_HZ)
def test_events_are_those_of_simulated_noise(poles_hz: tuple[float, float], noise: float) -> None:
    """Rate within 10 %, flips within 0.03, shares of intervals as follows.

    Intervals up to the median of the simulated ones are half of the native ones within 0.05, up to
    their 90 % quantile 90 % within 0.02. Short intervals are too frequent: up to the simulated 10 %
    quantile it is 10 % within 0.1.
    """
    side = 40
    phase = random_phase(THETA, side, 1)
    end = end_us(poles_hz)
    simulated = NoiseStatistics.of(
        simulated_events(poles_hz, noise * THETA, THETA, phase, end, 2), side, end
    )
    ours = native(poles_hz, noise, 100, side, 3)
    assert len(simulated.intervals_us) > 1500
    assert ours.rate_hz.agrees(simulated.rate_hz, 0.1 * simulated.rate_hz.value)
    assert ours.flips.agrees(simulated.flips, 0.03)
    for share, model_error in ((0.1, 0.1), (0.5, 0.05), (0.9, 0.02)):
        interval_us = simulated.quantile_us(share)
        below = simulated.share_below(interval_us)
        assert below.value == pytest.approx(share, abs=0.002)
        assert ours.share_below(interval_us).agrees(below, model_error), share


@pytest.mark.parametrize("tick_us", [20, 1_000, 10_000])
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("poles_hz", POLES_HZ)
def test_ticks_of_any_length_have_the_same_noise(
    poles_hz: tuple[float, float], noise: float, tick_us: int
) -> None:
    """Against ticks of 100 us: rate within 4 %, flips within 0.03, intervals as shares of 0.04."""
    side = 40
    fine, coarse = native(poles_hz, noise, 100, side, 3), native(poles_hz, noise, tick_us, side, 4)
    assert coarse.rate_hz.agrees(fine.rate_hz, 0.04 * fine.rate_hz.value)
    assert coarse.flips.agrees(fine.flips, 0.03)
    for share in (0.1, 0.5, 0.9):
        interval_us = fine.quantile_us(share)
        assert coarse.share_below(interval_us).agrees(fine.share_below(interval_us), 0.04), share


@pytest.mark.slow
@pytest.mark.parametrize("fastest_hz", [10, 100])
@pytest.mark.parametrize("noise", [0.2, 0.3, 0.5])
@pytest.mark.parametrize("poles_hz", [(300.0, 3000.0), (300.0, 900.0)])
def test_moving_light_has_the_events_of_simulated_noise(
    poles_hz: tuple[float, float], noise: float, fastest_hz: float
) -> None:
    """Ramps of up to so many thresholds a second, up and down: rates and flips."""
    side, end = 40, 60_000
    phase = random_phase(THETA, side, 1)
    fastest = fastest_hz * THETA * 1e-6
    slope = np.random.default_rng(9).uniform(-fastest, fastest, (side, side))
    simulated = NoiseStatistics.of(
        simulated_events(poles_hz, noise * THETA, THETA, phase, end, 2, slope), side, end
    )
    sensor = noisy_sensor(poles_hz, noise * THETA, THETA, side)
    for tick_us in (100, 1_000, 5_000, 10_000):
        events = native_events(sensor, even(side), phase, end, tick_us, 3, slope)
        ours = NoiseStatistics.of(events, side, end)
        assert ours.rate_hz.agrees(simulated.rate_hz, 0.1 * simulated.rate_hz.value)
        assert ours.flips.agrees(simulated.flips, 0.04)


@pytest.mark.parametrize("poles_hz", POLES_HZ)
def test_successive_events_of_noise_flip_their_polarity(poles_hz: tuple[float, float]) -> None:
    """After an event the reference lies off the signal, on the side from which the noise returns.

    Independent events would flip half of the time. The noise returns to its mean, which is nearer
    to the other threshold, unless it is so large that it reaches the next one, too. The shares are
    those of simulated noise, above.
    """
    for noise, least in ((0.3, 0.985), (0.5, 0.8)):
        flips = native(poles_hz, noise, 1000, 40, 4).flips
        assert flips.value - 3.3 * flips.error > least
    small, large = (native(poles_hz, noise, 1000, 40, 4).flips for noise in NOISES)
    assert small.value > large.value


# noise against illuminance
BIASES_HZ = [(2000.0, 30.0), (3000.0, 100.0), (4000.0, 300.0)]
"""bandwidths of photoreceptor (at 1000 lux) and source follower"""


def rates_by_illuminance(poles_hz: tuple[float, float]) -> list[Estimate]:
    """Rates at 12 illuminances from 0.1 lux to 10 klux, in Hz."""
    side, each, end = 48, 4, 1_000_000
    lux = np.geomspace(0.1, 1e4, side // each)
    light = np.tile(np.repeat(lux / WHITE_LUX, each).astype(np.float32), (side, 1))
    sensor = replace(noisy_sensor(poles_hz, 0.01, THETA, side, dark_lux=0.1), photocurrent_pa=0.3)
    events = native_events(sensor, light, random_phase(THETA, side, 1), end, 1000, 3)
    index = events["y"].astype(np.int64) * side + events["x"]
    counts = np.bincount(index, minlength=side**2).reshape(side, -1, each)
    seconds = np.full(side * each, end * 1e-6)
    return [Estimate.of(counts[:, k].reshape(-1), seconds) for k in range(len(lux))]


def test_noise_has_its_maximum_where_the_two_bandwidths_meet() -> None:
    """In the dark the photoreceptor is the slower pole, and its bandwidth grows with light.

    There the power of the noise is the same in any light, and its rate rises with the bandwidth.
    Where the follower is the slower one the power falls with light, and the rate much faster. With
    a faster follower the maximum is higher and in brighter light.
    """
    peaks, heights = [], []
    for poles_hz in BIASES_HZ:
        rates = rates_by_illuminance(poles_hz)
        values = np.array([rate.value for rate in rates])
        errors = np.array([rate.error for rate in rates])
        peak = int(values.argmax())
        assert 2 <= peak <= 8
        assert values[peak] > 3.5 * values[0] > 0
        # up, then down to nothing; between neighbours, beyond their errors
        steps, spread = np.diff(values), 3.3 * np.hypot(errors[1:], errors[:-1])
        assert np.all(steps[:peak] >= -spread[:peak])
        assert np.all(steps[peak:] <= spread[peak:])
        assert values[-1] == 0
        # where the two bandwidths are the same, within half a decade
        equal_lux = WHITE_LUX * poles_hz[1] / poles_hz[0]
        lux = np.geomspace(0.1, 1e4, len(rates))
        assert abs(math.log10(lux[peak] / equal_lux)) < 0.5
        peaks.append(peak)
        heights.append(values[peak])
    assert peaks == sorted(peaks)
    assert heights == sorted(heights)


# steps of light
def first_on_us(events: Events, side: int) -> F64:
    """When each pixel has its first ON event, us; NaN: it has none."""
    first = np.full(side * side, np.nan)
    on = events[events["p"] == 1][::-1]  # the first one is written last
    first[on["y"].astype(np.int64) * side + on["x"]] = on["t"]
    return first


def step_of_light(
    sensor: SensorParameters,
    before_lux: float,
    after_lux: float,
    *,
    rest_us: int,
    end_us: int,
    tick_us: int,
    seed: int,
    noiseless_reference: bool = False,
) -> Events:
    """Events after a step of light within a us at time 0, which follows on a rest."""
    side = sensor.width
    before = even(side, before_lux / WHITE_LUX)
    after = even(side, after_lux / WHITE_LUX)
    model = PlainModel(sensor, 1)
    _, state = model.step(before, model.init(seed), -1 - rest_us, -rest_us)
    for t in range(-rest_us, 0, rest_us // 4):
        _, state = model.step(before, state, t, t + rest_us // 4)
    if noiseless_reference:
        at_phase(state, np.zeros((side, side)))
    parts = []
    for begin, end in [(0, 1)] + [(t + 1, t + 1 + tick_us) for t in range(0, end_us, tick_us)]:
        events, state = model.step(after, state, begin, end)
        parts.append(events)
    return join_events(parts)


DELAY, STEP = 6.0, 0.01
"""how long after a step of light events count, and the steps of the simulation, time constants"""


@functools.cache
def noise_paths() -> F64:
    """Paths of noise with one pole, (steps, paths), in deviations, stationary from the start."""
    rng = np.random.default_rng(11)
    kept = math.exp(-STEP)
    paths = rng.standard_normal((round(DELAY / STEP) + 1, 8000))
    paths[1:] *= math.sqrt(1 - kept**2)
    for before, now in itertools.pairwise(paths):
        now += kept * before
    return paths


DISCRETE = 0.5826 * math.sqrt(2 * STEP)
"""by how much the highest of discrete steps is below that of all times (Broadie, Glasserman and
Kou, 1997), deviations"""


@functools.cache
def highest_of_steps() -> tuple[F64, F64]:
    """Steps in deviations; and for each, sorted, how far signal and noise exceed the step."""
    steps = np.array([0, 1, 2, 3, 4, 5, 6, 8, 10, 14, 20, 30, 50, 80, 120, 200.0])
    passed = -np.expm1(-STEP * np.arange(len(noise_paths())))[:, None]
    highest = [np.sort((c * (passed - 1) + noise_paths()).max(axis=0)) for c in steps]
    return steps, np.array(highest) + DISCRETE


def share_that_responds(
    theta: float, dark_lux: float, power: float, before_lux: float, after_lux: float
) -> float:
    """Model of an S-curve: of pixels whose reference has the noise of the time it was set.

    Args:
        theta: ON threshold, log units.
        dark_lux: Dark current as an illuminance.
        power: Variance of the noise times the illuminance with the dark current, lux.
        before_lux: Illuminance before the step.
        after_lux: Illuminance after the step.
    """
    contrast = math.log((after_lux + dark_lux) / (before_lux + dark_lux))
    sigma0, sigma1 = (math.sqrt(power / (lux + dark_lux)) for lux in (before_lux, after_lux))
    steps, highest = highest_of_steps()
    c = min(contrast / sigma1, steps[-1])
    k = min(int(np.searchsorted(steps, c, side="right")) - 1, len(steps) - 2)
    weight = (c - steps[k]) / (steps[k + 1] - steps[k])
    sample = (1 - weight) * highest[k] + weight * highest[k + 1]
    nodes, weights = np.polynomial.hermite_e.hermegauss(24)
    levels = (theta + sigma0 * nodes - contrast) / sigma1
    ranks = (np.arange(sample.size) + 0.5) / sample.size
    below = np.interp(levels, sample, ranks, left=0.0, right=1.0)
    return float(1 - (weights * below).sum() / weights.sum())


LUX = [0.3, 1.0, 3.0, 30.0, 300.0]
S_THETA, S_DARK_LUX = 0.25, 1.0
S_POWER = (S_THETA / 6) ** 2 * (LUX[0] + S_DARK_LUX)
S_SIDE = 48


@functools.cache
def s_curves() -> list[tuple[float, float, float]]:
    """Illuminances before and after steps, and the share of pixels that responded."""
    pole_hz = 100.0
    tau_us = 1e6 / (2 * math.pi * pole_hz)
    sigma = math.sqrt(S_POWER / (WHITE_LUX + S_DARK_LUX))
    sensor = noisy_sensor((0.0, pole_hz), sigma, S_THETA, S_SIDE, dark_lux=S_DARK_LUX)
    found: list[tuple[float, float, float]] = []
    for before in LUX:
        width = math.sqrt(2 * S_POWER / (before + S_DARK_LUX))
        for place in np.linspace(-3.2, 1.6, 13):
            after = (before + S_DARK_LUX) * math.exp(S_THETA + place * width) - S_DARK_LUX
            events = step_of_light(
                sensor, before, after, rest_us=4 * round(2 * tau_us),
                end_us=round(DELAY * tau_us / 100) * 100, tick_us=100, seed=len(found),
            )  # fmt: skip
            responded = np.isfinite(first_on_us(events, S_SIDE)).mean()
            found.append((before, after, float(responded)))
    return found


@pytest.mark.slow
def test_s_curves_give_back_threshold_dark_current_and_noise() -> None:
    """The inference of McReynolds et al. (arXiv 2404.07656) gives each back within 3 %.

    Contrast is ln((I2 + I_dark) / (I1 + I_dark)), and threshold, dark current and the power of the
    noise follow from five curves at once, by maximum likelihood. The model is of its own: signal
    and noise of one pole, simulated in fine steps, exceed the threshold within 6 time constants
    of a step, over a reference that was set with noise, too.
    """
    curves = s_curves()
    pixels = S_SIDE**2

    def deviance(logs: F64) -> float:
        theta, dark_lux, power = np.exp(logs)
        total = 0.0
        for before, after, share in curves:
            model = share_that_responds(theta, dark_lux, power, before, after)
            model = min(max(model, 1e-4), 1 - 1e-4)
            total -= share * math.log(model) + (1 - share) * math.log(1 - model)
        return total * pixels

    truth = np.log([S_THETA, S_DARK_LUX, S_POWER])
    start = truth + [0.3, -0.5, 0.6]
    fit = scipy.optimize.minimize(deviance, start, method="Nelder-Mead", options={"maxfev": 400})
    theta, dark_lux, power = np.exp(fit.x - truth)
    assert theta == pytest.approx(1.0, abs=0.03)
    assert dark_lux == pytest.approx(1.0, abs=0.03)
    assert math.sqrt(power) == pytest.approx(1.0, abs=0.03)


@pytest.mark.slow
def test_s_curves_widen_in_the_dark() -> None:
    """From 16 % to 84 % that respond, in the contrast ln(I2 / I1) that one sets."""
    widths, middles = [], []
    for lux in LUX:
        points = [
            (math.log(after / lux), share) for before, after, share in s_curves() if before == lux
        ]
        contrast, share = np.array(points).T
        low, middle, high = np.interp([0.16, 0.5, 0.84], share, contrast)
        widths.append(high - low)
        middles.append(middle)
    assert widths == sorted(widths, reverse=True)
    # dark current takes part of the contrast
    assert middles[:3] == sorted(middles[:3], reverse=True)
    assert middles[2] > 1.1 * middles[-1]
    assert widths[0] > 10 * widths[-1]


# latency
def test_latency_jitters_by_ms_in_the_dark_and_by_us_in_the_light() -> None:
    """Steps of contrast d over references without noise, in five illuminances up to 1000 lux.

    The signal reaches the threshold with the slope w (d - theta). Its jitter is sigma / slope, as
    long as the noise stands still while the signal sweeps its range.
    """
    side, sigma, contrast, dark_lux = 48, 0.01, 0.8, 1e-3
    found = []
    for lux in (0.1, 1.0, 10.0, 100.0, 1000.0):
        sensor = noisy_sensor((3000.0, 0.0), sigma, THETA, side, dark_lux=dark_lux)
        w = 2 * math.pi * 3000e-6 * (lux + dark_lux) / (WHITE_LUX + dark_lux)
        before = (lux + dark_lux) * math.exp(-contrast) - dark_lux
        tick_us = max(1, round(0.03 / w))
        events = step_of_light(
            sensor, before, lux, rest_us=4 * math.ceil(5 / w),
            end_us=tick_us * math.ceil(2 / w / tick_us), tick_us=tick_us,
            seed=3, noiseless_reference=True,
        )  # fmt: skip
        first = first_on_us(events, side)
        assert np.isfinite(first).all()
        slope = w * (contrast - THETA)
        expected = math.hypot(sigma / slope, math.sqrt(1 / 12))  # stamps are whole us
        found.append(first.std())
        assert first.std() == pytest.approx(expected, rel=0.015 + 3.3 / math.sqrt(2 * side**2))
    assert found[0] > 5_000
    assert found[-1] < 5


# the same bytes
BUSY = noisy_sensor(
    (300.0, 900.0), 0.4 * THETA, THETA, 40,
    leak_rate_hz=2.0, sigma_thres=0.02, refractory_period_s=0.0005,
)  # fmt: skip


def busy_light(k: int) -> F32:
    """Still, then moving, then still again; from left to right darker."""
    columns = np.geomspace(1.0, 0.003, 40)
    moved = math.exp(0.4 * math.sin(0.3 * min(max(k - 30, 0), 40)))
    return np.tile(columns * moved, (40, 1)).astype(np.float32)


def busy_run(model: PlainModel, cut: int | None = None) -> tuple[Events, PlainState]:
    """120 ticks of 1 ms; before the one named `cut` the state is saved and restored."""
    state, parts = model.init(7), []
    for k in range(120):
        if k == cut:
            state = PlainState.restore(state.save())
        events, state = model.step(busy_light(k), state, k * 1000, (k + 1) * 1000)
        parts.append(events)
    return join_events(parts), state


def test_threads_instruction_sets_and_saving_give_the_same_bytes() -> None:
    expected, state = busy_run(PlainModel(BUSY, 1, "portable"))
    assert len(expected) > 5_000
    for isa in _core.isa_available():
        for threads in (1, 2):
            for cut in (None, 17, 50):
                events, ours = busy_run(PlainModel(BUSY, threads, isa), cut)
                assert events.tobytes() == expected.tobytes(), (isa, threads, cut)
                assert ours == state


@pytest.mark.parametrize("leak_hz", [0.0, 2.0])
@pytest.mark.parametrize("sigma", [0.2, 0.25])
def test_blocks_that_are_skipped_have_the_same_events(leak_hz: float, sigma: float) -> None:
    """A block of pixels is skipped until one may fire; here it is never skipped, either."""
    side = 40
    sensor = noisy_sensor((300.0, 900.0), sigma * THETA, THETA, side, leak_rate_hz=leak_hz)
    light = even(side)

    def events_of(awake: bool) -> tuple[Events, int]:
        model = PlainModel(sensor, 1)
        _, state = model.step(light, model.init(1), -1, 0)
        at_phase(state, random_phase(THETA, side, 2) * 0.5)
        parts, skipped = [], 0
        for t in range(0, 1_000_000, 1000):
            assert state.due_us is not None
            if awake:
                state.due_us[:] = state.clock_us
            skipped += int(np.count_nonzero(state.due_us > state.clock_us + 1000))
            events, state = model.step(light, state, t, t + 1000)
            parts.append(events)
        return join_events(parts), skipped

    (usual, skipped), (awake, none) = events_of(False), events_of(True)
    assert len(usual) > 100
    assert skipped > 0 == none
    assert usual.tobytes() == awake.tobytes()
