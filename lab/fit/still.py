"""Background events of a still view: leak, noise, their spread over pixels, and the hot tail.

Leak is a regular train of ON events, noise a random one of both polarities. So the OFF events give
the noise and the ON events beside as many give the leak. Rates are log-normal over pixels, and so
is the tail of hot pixels, whose leak adds to the usual one. All of it is one fit to the counts of
the pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs.emulator.sensor.parameters import MOST_HOT_LEAK_HZ
from evs.msgs import EvsError
from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.likelihood import (
    bin_edges,
    fit_bins,
    mixed_probabilities,
    stages_covariance,
)
from evs_lab.fit.observed import F64, I64, Mask, Observed

DECADE = math.log(10.0)

KEYS = (
    "leak_rate_hz",
    "shot_noise_rate_hz",
    "noise_rate_cov_decades",
    "hot_leak_median_hz",
    "hot_leak_cov_decades",
)

FEWEST_EVENTS = 30
"""of a polarity, for a rate"""

BETTER = 5.0
"""by how much a further parameter must raise the log likelihood: chance does once in 600 fits"""

MOST_NOISE = 3.0
"""noise events for each event of leak beyond which the leak is lost in them"""

ROUGH_LEAK, ROUGH_TAIL, ROUGH_SPREAD = 0.2, 3.0, 0.5
"""errors if all were noise: of leak and of the tail's median, relative; of its spread, decades"""

ROUGH_NOISE = 0.01, 0.02
"""relative errors of the rate of the noise and of its spread by what the model leaves out"""

LN_LOW, LN_HIGH = -14.0, 9.0
"""natural logarithm of the lowest and the highest rate of a pixel, Hz"""

GRID = 1000
"""rates that the leak of a population is described by, so close that whole counts blur them"""

BLUR = (LN_HIGH - LN_LOW) / GRID / math.sqrt(6.0)
"""what a place of the grid stands for, standard deviation of the logarithm"""

SPREAD = {"spread": math.log(0.4)}
"""where the search for a spread begins, natural logarithm of natural log units"""

LOW = {"spread": math.log(0.003), "tail_spread": 0.0}
HIGH = {"spread": math.log(3.0), "tail_spread": math.log(7.0)}
"""ends of the search for what is no rate; a tail is wider than 0.43 decades"""


@dataclass(frozen=True)
class Background:
    """What a still view shows; rates are means over pixels, Hz."""

    lux: float
    leak: tuple[float, float]
    """rate, standard error; without the hot tail. NaN: lost"""
    noise: tuple[float, float]
    """both polarities"""
    spread: tuple[float, float]
    """of both rates, decades; NaN: lost"""
    tail_median: tuple[float, float]
    """of the hot tail; NaN: there is none to be seen"""
    tail_spread: tuple[float, float]
    """decades"""
    leak_hz: F64
    """(pixels,) leak of each pixel as counted, unbiased but noisy"""
    seconds: float
    source: str
    reasons: dict[str, str]
    """key -> why it cannot be told"""


@dataclass(frozen=True)
class _Model:
    """Probabilities of the bins of a pixel's counts; parameters are natural logarithms."""

    edges: I64
    seconds: float
    uneven_on: float
    """spread of noise by thresholds, standard deviation of its logarithm"""
    uneven_off: float

    def off(self, value: dict[str, float]) -> F64:
        """Of OFF events, which are noise."""
        rates, shares = self._noise(value, self.uneven_off, 121)
        return mixed_probabilities(
            self.edges, np.zeros(len(rates)), 0.5 * rates * self.seconds, shares
        )

    def on(self, value: dict[str, float]) -> F64:
        """Of ON events, which are noise, leak, and the tail of leak."""
        rates, shares = self._noise(value, self.uneven_on, 45)
        leaks, weights = self._leaks(value)
        s, leak = rates[:, None], leaks[None, :]
        # each noise event sets back the reference of a pixel that leaks
        ratio = np.minimum(s / np.maximum(leak, 1e-9), 600.0)
        kept = np.where(ratio > 1e-9, ratio / np.expm1(np.maximum(ratio, 1e-9)), 1.0)
        count, regular = leak * kept * self.seconds, np.exp(-ratio)
        chance = count * (1.0 - regular) + 0.5 * s * self.seconds
        weight = (shares[:, None] * weights[None, :]).ravel()
        kept_nodes = weight > 1e-8
        return mixed_probabilities(
            self.edges,
            (count * regular).ravel()[kept_nodes],
            chance.ravel()[kept_nodes],
            weight[kept_nodes],
            BLUR,
        )

    def _noise(self, value: dict[str, float], uneven: float, most: int) -> tuple[F64, F64]:
        """(rates, weights), at most so many."""
        if "noise" not in value:
            return np.zeros(1), np.ones(1)
        mean = math.exp(value["noise"])
        sigma = math.hypot(_spread(value), uneven)
        # as close as chance blurs them
        blur = math.sqrt(max(0.5 * mean * self.seconds, 1.0))
        return _log_normal(mean, sigma, min(max(9, math.ceil(14.0 * sigma * blur)), most))

    def _leaks(self, value: dict[str, float]) -> tuple[F64, F64]:
        """(rates, weights) of the usual leak and the tail in sum."""
        if "leak" not in value:
            return np.zeros(1), np.ones(1)
        # whole counts of a regular train blur nothing: without noise the nodes are close
        close = 71 if "noise" in value or "tail_median" in value else 701
        base, shares = _log_normal(math.exp(value["leak"]), _spread(value), close)
        if "tail_median" not in value:
            return base, shares
        median, sigma = math.exp(value["tail_median"]), math.exp(value["tail_spread"])
        z, weights = _nodes(401)
        tail = np.minimum(median * np.exp(sigma * z), MOST_HOT_LEAK_HZ)
        rates = (base[:, None] + tail[None, :]).ravel()
        grid = GRID // 3 if "noise" in value else GRID
        return _regrouped(rates, (shares[:, None] * weights[None, :]).ravel(), grid)


def _spread(value: dict[str, float]) -> float:
    return math.exp(value["spread"]) if "spread" in value else 0.0


def _nodes(count: int) -> tuple[F64, F64]:
    """Standard normal numbers and their weights."""
    z = np.linspace(-4.5, 4.5, count)
    weight = np.exp(-0.5 * z * z)
    return z, weight / weight.sum()


def _log_normal(mean: float, sigma: float, count: int) -> tuple[F64, F64]:
    """(values, weights) of a log-normal number with this mean."""
    if not mean > 0.0 or sigma < 1e-6:
        return np.array([mean]), np.ones(1)
    z, weight = _nodes(count)
    return np.asarray(mean * np.exp(sigma * z - 0.5 * sigma * sigma)), weight


def _regrouped(rates: F64, weights: F64, size: int) -> tuple[F64, F64]:
    """The same distribution on a grid of logarithms, each rate shared between its neighbours."""
    place = (np.log(np.maximum(rates, 1e-300)) - LN_LOW) / (LN_HIGH - LN_LOW) * (size - 1)
    place = np.clip(place, 0.0, size - 1.001)
    whole = place.astype(np.int64)
    part = place - whole
    shares: F64 = np.bincount(whole, weights * (1.0 - part), size).astype(np.float64)
    shares += np.bincount(whole + 1, weights * part, size)
    grid: F64 = np.exp(np.linspace(LN_LOW, LN_HIGH, size))
    return grid[shares > 1e-9], shares[shares > 1e-9]


def fit_still(
    seen: Observed,
    lux: float,
    unevenness: tuple[float, float] = (0.15, 0.15),
    alive: Mask | None = None,
) -> Background:
    """Fit the background.

    Args:
        seen: A view without any change, or a lens cap.
        lux: Illuminance of the sensor; 0: a lens cap.
        unevenness: Of ON and OFF thresholds, standard deviation over mean: uneven pixels are
            unevenly noisy.
        alive: (pixels,) those that answer light; None: all of them.

    Raises:
        EvsError: The recording has no duration, or the illuminance is senseless.
    """
    if not seen.seconds > 0.0:
        raise EvsError(f"{seen.source}: all its events have one stamp; record some seconds")
    if not lux >= 0.0 or not math.isfinite(lux):
        raise EvsError(f"--still-lux is {lux:g}; give the illuminance of the sensor, 0 or more")
    used = np.ones(seen.pixels, bool) if alive is None else alive
    on, off, seconds = seen.on_counts[used], seen.off_counts[used], seen.seconds
    noise = int(off.sum()) >= FEWEST_EVENTS
    excess = int(on.sum()) - int(off.sum())
    leak = excess >= max(FEWEST_EVENTS, 3.0 * math.sqrt(float(on.sum() + off.sum())))
    lost = _reasons(seen, noise, leak)
    edges = bin_edges(int(max(on.max(), off.max())))
    # of 1 / theta, to fourth order
    uneven = [math.sqrt(math.log1p(u**2 * (1.0 + 6.0 * u**2))) for u in unevenness]
    model = _Model(edges, seconds, uneven[0], uneven[1])
    stages: list[_Stage] = []
    if noise:
        start = {"noise": math.log(2.0 * float(off.mean()) / seconds)}
        bins = np.searchsorted(edges, off).astype(np.int64)
        stages.append(_fit_stage(bins, model.off, {}, [start, start | SPREAD]))
    if leak:
        known = dict(stages[0].value) if stages else {}
        size = math.log(excess / len(on) / seconds)
        start = {"leak": size}
        tried = [start] if "spread" in known else [start, start | SPREAD]
        bins = np.searchsorted(edges, on).astype(np.int64)
        plain = _fit_stage(bins, model.on, known, tried)
        own = {name: plain.value[name] for name in plain.own}
        tail = {"leak": size - 0.7, "tail_median": size - 2.3, "tail_spread": math.log(2.0)}
        stages.append(_fit_stage(bins, model.on, known, [own, own | tail]))
    return _background(seen, lux, stages, lost)


@dataclass(frozen=True)
class _Stage:
    """The fit of one polarity."""

    bins: I64
    probabilities: Callable[[dict[str, float]], F64]
    value: dict[str, float]
    """with those of the stages before"""
    own: tuple[str, ...]
    """the parameters that it has fitted"""


def _fit_stage(
    bins: I64,
    probabilities: Callable[[dict[str, float]], F64],
    known: dict[str, float],
    tried: list[dict[str, float]],
) -> _Stage:
    """The fit with those terms that the counts ask for."""
    best_worth, best = -math.inf, dict(known)
    own: tuple[str, ...] = ()
    for start in tried:
        names = list(start)

        def shares(point: F64, names: list[str] = names) -> F64:
            return probabilities(known | dict(zip(names, point.tolist(), strict=True)))

        bounds = (
            np.array([LOW.get(name, LN_LOW) for name in names]),
            np.array([HIGH.get(name, LN_HIGH) for name in names]),
        )
        fit = fit_bins(bins, shares, np.array([start[name] for name in names]), bounds)
        # a term more must be worth it
        worth = fit.log_likelihood - BETTER * len(names)
        if worth > best_worth:
            best_worth, own = worth, tuple(names)
            best = known | dict(zip(names, fit.parameters.tolist(), strict=True))
    return _Stage(bins, probabilities, best, own)


def _variance(stages: list[_Stage]) -> dict[str, float]:
    """Of each fitted parameter; NaN: its error has no bound."""
    if not stages:
        return {}
    names = list(stages[-1].value)
    point = np.array([stages[-1].value[name] for name in names])

    def of(stage: _Stage) -> Callable[[F64], F64]:
        there = set(stage.value)
        return lambda at: stage.probabilities(
            {n: v for n, v in zip(names, at.tolist(), strict=True) if n in there}
        )

    parts = [(one.bins, of(one), [names.index(name) for name in one.own]) for one in stages]
    covariance = stages_covariance(parts, point)
    return dict(zip(names, np.diag(covariance).tolist(), strict=True))


def _background(
    seen: Observed, lux: float, stages: list[_Stage], lost: dict[str, str]
) -> Background:
    value = stages[-1].value if stages else {}
    variance = _variance(stages)
    if any(math.isnan(one) for one in variance.values()):
        # a leak that is lost in the noise has no error; the noise has its own
        variance |= _variance(stages[:1])
    nothing = (math.nan, math.nan)
    none = (0.0, 1.0 / (seen.pixels * seen.seconds))

    def told(name: str, none: tuple[float, float]) -> tuple[float, float]:
        if name not in value:
            return none
        size = math.exp(value[name])
        return size, size * math.sqrt(max(variance[name], 0.0))

    def decades(name: str) -> tuple[float, float]:
        size, error = told(name, nothing)
        return size / DECADE, error / DECADE

    noise, spread = (
        (size, math.hypot(error, rough * size))
        for (size, error), rough in zip(
            (told("noise", none), decades("spread")), ROUGH_NOISE, strict=True
        )
    )
    leak = told("leak", none)
    # where noise sets back the leak, what is left of a weak one is known roughly
    rough = told("noise", none)[0] / max(told("noise", none)[0] + leak[0], 1e-9)
    leak = leak[0], math.hypot(leak[1], ROUGH_LEAK * rough * leak[0])
    tail, wide = told("tail_median", nothing), decades("tail_spread")
    tail = tail[0], math.hypot(tail[1], ROUGH_TAIL * rough * tail[0])
    wide = wide[0], math.hypot(wide[1], ROUGH_SPREAD * rough)
    if "leak" in value and math.exp(value.get("noise", -math.inf)) > MOST_NOISE * leak[0]:
        leak = nothing
        for key in ("leak_rate_hz", "hot_leak_median_hz", "hot_leak_cov_decades"):
            lost[key] = "noise sets back the leak of most pixels before it gives an event"
    elif "leak" in value and "tail_median" not in value:
        reason = "no pixels leak more than the spread of the others explains"
        lost["hot_leak_median_hz"] = lost["hot_leak_cov_decades"] = reason
    if value.get("spread", 0.0) > HIGH["spread"] - 0.05:
        reason = "the rates of the pixels differ more than noise does; did something move?"
        leak = nothing
        for key in (*lost, *KEYS):
            lost[key] = reason
    elif value and "spread" not in value:
        lost["noise_rate_cov_decades"] = "the counts of the pixels differ no more than by chance"
    return Background(
        lux,
        leak=leak,
        noise=noise,
        spread=spread,
        tail_median=tail,
        tail_spread=wide,
        leak_hz=(seen.on_counts - seen.off_counts) / seen.seconds,
        seconds=seen.seconds,
        source=seen.source,
        reasons=lost,
    )


def _reasons(seen: Observed, noise: bool, leak: bool) -> dict[str, str]:
    reasons: dict[str, str] = {}
    rate = f"in {seen.pixels:,} pixels and {seen.seconds:.3g} s"
    if not noise:
        reasons["shot_noise_rate_hz"] = f"{int(seen.off_counts.sum())} OFF events {rate}"
    if not leak:
        excess = int(seen.on_counts.sum()) - int(seen.off_counts.sum())
        reasons["leak_rate_hz"] = f"{excess} more ON than OFF events {rate}"
    if not noise and not leak:
        reasons["noise_rate_cov_decades"] = f"too few events {rate}"
    if not leak:
        for key in ("hot_leak_median_hz", "hot_leak_cov_decades"):
            reasons[key] = f"no leak shows {rate}"
    return reasons


def still_estimates(found: Background) -> list[Estimate]:
    """The keys of one still view; those of several light levels are in laws.py."""
    values = found.leak, found.noise, found.spread, found.tail_median, found.tail_spread
    pairs = dict(zip(KEYS, values, strict=True))
    estimates = []
    for key, (value, error) in pairs.items():
        if key in found.reasons:
            estimates.append(cannot(key, found.source, found.reasons[key]))
        else:
            estimates.append(Estimate(key, value, error, found.source).checked())
    return estimates
