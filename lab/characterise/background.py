"""Background rate: events of pixels under constant light, by polarity and regularity.

Leak is regular and ON. Shot noise is random and has both polarities alike. So the OFF events give
the shot noise, and the excess of ON events gives the leak. An event of photon noise moves the
reference by a threshold, so it hides no leak. One of Poisson noise restarts the leak of its pixel;
what it hides is added (`leak_without_noise`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.noise_rate import hot_tail, leak_rate_hz, noise_rate_hz
from evs_lab.characterise.bench import F64, Bench, LightExposure, Mask, pixel_numbers
from evs_lab.characterise.fit import mean_and_error
from evs_lab.characterise.quantity import Quantity

LADDER_LUX = (0.1, 1.0, 10.0, 100.0, 1_000.0, 10_000.0, 100_000.0)

EVENTS = 600_000
"""about so many are counted in all"""

A_PIXEL = 100.0
"""and no more for one pixel"""

LONGEST_S = 1000.0
FIRST_LOOK_S = 0.1
TICKS = 32
"""of the first look; noise does not depend on their length"""

MOST_A_TICK = 0.1
"""most events of a pixel in a tick, on average"""

LONGEST_TICK_S = 0.1
"""of a sensor with photon noise: in longer ticks, hot pixels lose events"""

HOT = 10.0
"""a pixel is hot if it has more events than chance gives a pixel of so many times the usual rate"""

LEAST_INTERVALS = 4
"""between the events of a pixel whose regularity counts"""

HANN = 1.5
"""mean square of Hann's window: the variance of a weighted sum over that of a count"""

SURE = 5.0
"""standard errors that an excess of ON events must have"""

RARE = 0.01
"""share of the noise that pixels with the mean threshold have, below which rare pixels have it"""

ROUGH_NOISE = 3.0
"""photon noise that is not so many times as frequent as leak is predicted roughly"""

MOST_NOISE = 4.0
"""noise events per leak event beyond which the remaining leak events tell too little"""


@dataclass(frozen=True)
class Background:
    """Noise at one illuminance; rates are means over the pixels that are not hot, Hz.

    Shot noise is the mean over all pixels, as the set rate is: pixels with low thresholds have most
    of the noise of a sensor.
    """

    lux: float
    pixels: int
    """number of pixels"""
    seconds: float
    """length of the measurement"""
    on: tuple[float, float]
    """rate, standard error"""
    off: tuple[float, float]
    leak: tuple[float, float]
    """rate that the leak would have without noise; NaN: lost in it"""
    shot: tuple[float, float]
    """both polarities, over all pixels"""
    irregularity: float
    """of the intervals between ON events of a pixel, standard deviation over mean: 0 for leak
    alone, 1 for shot noise alone; NaN: too few"""
    hot_share: float
    """of all pixels"""
    hot_rate: tuple[float, float]
    """of those, both polarities; NaN: there are none"""
    hot_hz: float
    """rate from which on a pixel counts as hot"""


@dataclass(frozen=True)
class _Observation:
    """The counts at one illuminance."""

    lux: float
    seconds: float
    on: F64
    """(h w,) rates, Hz"""
    off: F64
    hot: Mask
    hot_hz: float
    irregularity: float


def measure_background(
    bench: Bench,
    ladder_lux: Sequence[float],
    unevenness: float = 0.0,
    moved: Callable[[float], None] = lambda _: None,
) -> list[Background]:
    """Measure each illuminance until there are enough events.

    Args:
        bench: the bench with the sensor.
        ladder_lux: illuminances to measure.
        unevenness: of OFF thresholds, standard deviation over mean, from their S-curve: uneven
            pixels are unevenly noisy.
        moved: called with each illuminance before it begins.
    """
    observations = []
    for lux in ladder_lux:
        moved(lux)
        observations.append(_observe(bench, lux))
    # where noise is strongest, chance hides its spread least
    noisy = max(observations, key=lambda observation: float(observation.off.mean()))
    spreads = find_spreads(noisy.off[~noisy.hot], noisy.seconds, unevenness)
    restarts = bench.sensor.shot_noise_rate_hz > 0.0
    return [_summarise(observation, spreads, restarts) for observation in observations]


def _observe(bench: Bench, lux: float) -> _Observation:
    exposure = bench.start(lux)
    rate = _first_rate(exposure, lux)
    nothing = np.zeros(bench.pixels)
    if rate == 0.0:
        quiet = np.zeros(bench.pixels, bool)
        return _Observation(lux, exposure.t_us * 1e-6, nothing, nothing, quiet, math.inf, math.nan)
    seconds = min(LONGEST_S, min(EVENTS / bench.pixels, A_PIXEL) / rate)
    ticks = math.ceil(max(2 * TICKS, seconds * rate / MOST_A_TICK))
    if bench.sensor.photocurrent_pa > 0.0:
        ticks = max(ticks, math.ceil(seconds / LONGEST_TICK_S))
    tick_us = math.ceil(seconds / ticks * 1e6)
    begin_us, span_us = exposure.t_us, ticks * tick_us
    pixels, times, polarities = [], [], []
    for _ in range(ticks):
        events = exposure.expose(lux, tick_us)
        pixels.append(pixel_numbers(events, bench.sensor))
        times.append((events["t"] - begin_us) / span_us)
        polarities.append(events["p"] == 1)
    pixel, when, on = (np.concatenate(parts) for parts in (pixels, times, polarities))
    seconds = span_us * 1e-6

    # Hann's window: regular events count by their rate, whatever the phase at the beginning
    weight = 1.0 - np.cos(2.0 * math.pi * when)
    rate_on = np.bincount(pixel[on], weight[on], bench.pixels) / seconds
    rate_off = np.bincount(pixel[~on], weight[~on], bench.pixels) / seconds
    # a pixel has no events while it is blind
    blind = (rate_on + rate_off) * bench.sensor.refractory_period_s
    awake = 1.0 / np.maximum(1.0 - blind, 0.1)
    counts = np.bincount(pixel, minlength=bench.pixels)
    most = _most_of_usual(counts)
    hot = counts > most
    irregularity = _irregularity(pixel[on], when[on], hot)
    hot_hz = most / seconds
    return _Observation(lux, seconds, rate_on * awake, rate_off * awake, hot, hot_hz, irregularity)


def _first_rate(exposure: LightExposure, lux: float) -> float:
    """Rough rate of events of a pixel, Hz; 0: there are none."""
    pixels, tick_us = exposure.bench.pixels, math.ceil(FIRST_LOOK_S / TICKS * 1e6)
    while True:
        count = sum(len(exposure.expose(lux, tick_us)) for _ in range(TICKS))
        if count >= 0.2 * pixels or exposure.t_us > 0.5e6 * LONGEST_S:
            return count / pixels / (TICKS * tick_us * 1e-6)
        tick_us *= 2


def _summarise(observation: _Observation, spreads: Spreads, restarts: bool) -> Background:
    usual = ~observation.hot
    every, off = (mean_and_error(part) for part in (observation.off, observation.off[usual]))
    excess = mean_and_error((observation.on - observation.off)[usual])
    shot, beside_leak = ((2.0 * rate, 2.0 * error) for rate, error in (every, off))
    return Background(
        observation.lux,
        len(observation.hot),
        observation.seconds,
        on=mean_and_error(observation.on[usual]),
        off=off,
        leak=leak_without_noise(excess, beside_leak, spreads) if restarts else excess,
        shot=shot,
        irregularity=observation.irregularity,
        hot_share=float(observation.hot.mean()),
        hot_rate=mean_and_error((observation.on + observation.off)[observation.hot]),
        hot_hz=observation.hot_hz,
    )


def _most_of_usual(counts: npt.NDArray[np.int64]) -> float:
    """Number of events over which a pixel is hot."""
    usual = counts[counts <= np.quantile(counts, 0.95)].mean()
    limit = HOT * usual
    return float(limit + 6.0 * math.sqrt(limit) + 6.0)


def _irregularity(pixel: npt.NDArray[np.int64], when: F64, hot: Mask) -> float:
    """Over the pixels with enough intervals, but hot ones."""
    order = np.lexsort((when, pixel))
    pixel, when = pixel[order], when[order]
    same = np.diff(pixel) == 0
    owner, interval = pixel[1:][same], np.diff(when)[same]
    count = np.bincount(owner, minlength=len(hot))
    total = np.bincount(owner, interval, len(hot))
    squares = np.bincount(owner, interval**2, len(hot))
    chosen = (count >= LEAST_INTERVALS) & ~hot
    if not chosen.any():
        return math.nan
    count, mean = count[chosen], total[chosen] / count[chosen]
    variance = (squares[chosen] - count * mean**2) / (count - 1)
    return float(np.sqrt(np.maximum(variance, 0.0).sum() / (mean**2).sum()))


@dataclass(frozen=True)
class Spreads:
    """Spreads of log-normal rates over the pixels: standard deviations of ln."""

    leak: float
    shot: float


def leak_without_noise(
    excess: tuple[float, float], shot: tuple[float, float], spreads: Spreads
) -> tuple[float, float]:
    """(L, standard error): the leak rate behind an excess d of ON events under noise of rate s.

    A pixel leaks where noise is silent for 1 / L, so that d = s / (exp(s / L) - 1); here in the
    mean over pixels whose L and s are log-normal. NaN where d is lost in the noise.

    Args:
        excess: (d, standard error), Hz.
        shot: (s, standard error), Hz.
        spreads: of the rates over the pixels.
    """
    (d, d_error), (s, s_error) = excess, shot
    if not s > 0.0:
        return excess
    if not d > SURE * d_error:
        return math.nan, math.nan
    leak = _solve(d, s, spreads)
    if s > MOST_NOISE * leak:
        return math.nan, math.nan
    by_d = _solve(d + d_error, s, spreads) - leak
    by_s = _solve(d, s + s_error, spreads) - leak
    return leak, math.hypot(by_d, by_s)


def _solve(d: float, s: float, spreads: Spreads) -> float:
    """L, by bisection of its logarithm; L is larger than d."""
    low, high = 0.0, math.log(1e6)
    for _ in range(50):
        middle = 0.5 * (low + high)
        enough = mean_excess(d * math.exp(middle), s, spreads) > d
        low, high = (low, middle) if enough else (middle, high)
    return d * math.exp(high)


def mean_excess(leak: float, shot: float, spreads: Spreads) -> float:
    """Rate of leak events under noise, Hz: the mean over log-normal rates with these means."""
    z = np.linspace(-4.0, 4.0, 33)
    weight = np.exp(-0.5 * z * z)
    weight /= weight.sum()

    def rates(mean: float, spread: float) -> F64:
        return np.asarray(mean * np.exp(spread * z - 0.5 * spread**2))

    leaks = rates(leak, spreads.leak)[np.newaxis, :]
    s = rates(shot, spreads.shot)[:, np.newaxis]
    return float(weight @ (s / np.expm1(np.minimum(s / leaks, 500.0))) @ weight)


def find_spreads(off: F64, seconds: float, unevenness: float) -> Spreads:
    """Find the spreads from the rates of the pixels' OFF events, which are all noise.

    Two other causes of spread are subtracted: chance in the counts, and the thresholds, which do
    not act on leak and differ between the polarities.

    Args:
        off: (n,) rates of OFF events, Hz.
        seconds: length of the measurement.
        unevenness: of thresholds, standard deviation over mean.
    """
    mean = float(off.mean())
    if not mean > 0.0:
        return Spreads(0.0, 0.0)
    chance = HANN * mean / seconds
    total = math.log1p(max(float(off.var()) - chance, 0.0) / mean**2)
    # of 1 / theta: its variance over its mean squared
    thresholds = unevenness**2 + 8.0 * unevenness**4
    own = max(total - thresholds, 0.0)
    return Spreads(math.sqrt(own), math.sqrt(own + min(0.5 * thresholds, total)))


def background_results(sensor: SensorParameters, found: Sequence[Background]) -> list[Quantity]:
    """Leak and shot noise of every illuminance; hot pixels of the quietest."""
    results = []
    for at in found:
        promised = noise_rate_hz(sensor, at.lux)
        note = _noise_note(sensor, at.lux, promised)
        # no law is known of references that follow the light
        promised = math.nan if sensor.highpass_hz else promised
        results.append(Quantity("shot noise rate", "Hz", *at.shot, promised, at.lux, note))
    for at in found:
        note = "the high pass takes part of it" if sensor.highpass_hz else ""
        note = "lost in shot noise" if math.isnan(at.leak[0]) else note
        restarts = sensor.shot_noise_rate_hz > 0.0
        if restarts and sensor.has_hot_pixels and at.shot[0] > 0.1 * at.leak[0]:
            note = "noise hides part of the hot tail"
        if at.leak[0] < 2.0 * at.leak[1] and at.shot[0] > 0.0:
            note = note or "lost in shot noise"
        promised = leak_rate_hz(sensor, at.lux, _of_tail(sensor, at))
        promised = math.nan if sensor.highpass_hz else promised
        results.append(Quantity("leak rate", "Hz", *at.leak, promised, at.lux, note))
    last = min(found, key=lambda at: at.on[0] + at.off[0])
    share = last.hot_share
    error = math.sqrt(share * (1.0 - share) / last.pixels)
    limit_hz = _of_tail(sensor, last)
    promised, above, _ = hot_tail(sensor, limit_hz)
    if sensor.highpass_hz:
        promised, above = math.nan, 0.0
    note = f"over {last.hot_hz:.3g} Hz"
    results.append(Quantity("hot pixels", "", share, error, promised, last.lux, note))
    if share > 0.0:
        promised = above + last.hot_hz - limit_hz if above else math.nan
        results.append(Quantity("rate of hot pixels", "Hz", *last.hot_rate, promised, last.lux))
    return results


def _noise_note(sensor: SensorParameters, lux: float, promised: float) -> str:
    """Where the set rate of the noise is no close bound of what a bench finds."""
    if not sensor.photocurrent_pa:
        return ""
    if sensor.highpass_hz:
        return "the high pass changes it"
    alike = replace(sensor, sigma_thres=0.0)
    if noise_rate_hz(alike, lux) < RARE * promised:
        return "rare pixels have nearly all of it"
    # leak then brings the reference to where the OFF threshold alone counts, not the mean of both
    if 0.0 < promised < leak_rate_hz(sensor, lux, 1.0) * ROUGH_NOISE:
        return "hardly more frequent than leak: set is rough"
    return ""


def usual_leak_hz(sensor: SensorParameters, found: Sequence[Background], lux: float) -> float:
    """Leak at an illuminance, mean over the pixels that are not hot at the nearest measurement."""
    if not found:
        return leak_rate_hz(sensor, lux)
    nearest = min(found, key=lambda at: abs(math.log(at.lux / lux)))
    return leak_rate_hz(sensor, lux, _of_tail(sensor, nearest))


def _of_tail(sensor: SensorParameters, at: Background) -> float:
    """What a pixel's part of the hot tail must exceed to be hot, Hz; the rest is usual."""
    return at.hot_hz - leak_rate_hz(sensor, at.lux, 0.0) - 2.0 * at.off[0]
