"""Thresholds and bandwidth from a blinking lamp of known contrast.

A flank brings whole events, and where between two of them the reference rests is not known. So the
counts of the pixels are compared with those of simulated pixels: the means of ON and OFF counts
fix the thresholds, their spread over pixels fixes the mismatch. Leak and noise between the flanks
are measured and simulated too, since they move the references.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.observed import F64, I64, Observed
from evs_lab.fit.period import flanks_us
from evs_lab.fit.ramp import KEYS, check_light

FEWEST_CYCLES = 4
BEFORE, AFTER = 0.02, 0.3
"""the longest window of a flank, in periods around its beginning"""

SETTLED = 0.25
"""longest time of a flank, in periods; the contrast of a longer one is not all there"""

CALM = 0.45
"""until then nothing changes, in periods"""

LATE = 0.002
"""share of the events of a flank that may come after its window"""

SIMULATED = 10_000
"""pixels; their chance adds to that of the recording"""

MOST_CYCLES = 12
SETTLED_CYCLES = 6
"""simulated before counts begin"""

ROUNDS = 12
STEP = 0.02
"""of numeric derivatives, relative"""

BETWEEN = 0.15
"""error, in events, for each event of leak or noise between two flanks"""

ROUGH, SPREAD_ROUGH = 0.002, 0.01
"""errors relative to thresholds, and to their mismatch"""

MOST_BLIND = 0.2
"""share of a flank that may pass unseen"""

OUT = 8.0
"""robust standard deviations beyond which the count of a pixel is left out"""


@dataclass(frozen=True)
class _Counts:
    """Events of the flanks."""

    on: F64
    """(pixels,) ON events of a rise, mean over cycles"""
    off: F64
    cycles: int
    leak_hz: float
    """between the flanks"""
    noise_hz: float
    """both polarities"""
    half_s: float
    burst_s: float
    """the longer of the bursts of events, s"""


def fit_lamp(
    seen: Observed,
    contrast: float,
    period_s: float,
    refractory_s: tuple[float, float] = (0.0, 0.0),
) -> tuple[Estimate, ...]:
    """Fit thresholds, their mismatch and dead pixels.

    Args:
        seen: A lamp that blinks, seen by all pixels.
        contrast: Its bright light over its dark light, more than 1; on the sensor, with the light
            that is there without the lamp.
        period_s: From one rise to the next, s.
        refractory_s: The time for which a pixel is blind after an event, and its standard error.

    Raises:
        EvsError: Contrast or period is senseless.
    """
    check_light(contrast, period_s)
    rises, falls = flanks_us(seen, period_s)
    if min(len(rises), len(falls)) < FEWEST_CYCLES:
        reason = f"{min(len(rises), len(falls))} flanks; record 10 periods"
        return tuple(cannot(key, seen.source, reason) for key in KEYS)
    counts, dead = _counts(seen, rises, falls, period_s)
    if counts.burst_s > SETTLED * period_s:
        reason = "the pixels have not settled when the lamp changes again: brighter, or slower"
        return *(cannot(key, seen.source, reason) for key in KEYS[:3]), dead
    found = _thresholds(seen.source, counts, math.log(contrast))
    shares = [blind_share(seen, begins, on, period_s, refractory_s[0])
              for begins, on in ((rises, True), (falls, False))]  # fmt: skip
    rough = refractory_s[1] / refractory_s[0] if refractory_s[0] > 0.0 else 0.0
    return *(_seen(one, shares, math.hypot(rough, 0.3)) for one in found), dead


def blind_share(
    seen: Observed, begins: I64, on: bool, period_s: float, refractory_s: float
) -> float:
    """Share of the log light of a flank that passes while the pixels are blind."""
    every = seen.intervals
    place = np.searchsorted(begins, every.begin_us, side="right") - 1
    late = every.begin_us - begins[np.maximum(place, 0)]
    chosen = (every.before_on == on) & (every.after_on == on) & (place >= 0)
    chosen &= (late < 1e6 * AFTER * period_s) & (every.length_us < 1e6 * AFTER * period_s)
    if not chosen.any() or not refractory_s > 0.0:
        return 0.0
    shares = 1e6 * refractory_s / np.maximum(every.length_us[chosen], 1)
    return float(np.minimum(shares, 1.0).mean())


def _seen(one: Estimate, shares: list[float], rough: float) -> Estimate:
    """A threshold without what passed while the pixel was blind, which an event takes along."""
    if not one.told:
        return one
    share = dict(zip(KEYS[:3], [*shares, max(shares)], strict=True))[one.key]
    if share > MOST_BLIND:
        reason = f"the pixels are blind for {100.0 * share:.0f} % of a flank; use a ramp"
        return cannot(one.key, one.source, reason)
    value = one.number * (1.0 - share)
    error = math.hypot(one.error * (1.0 - share), rough * share * one.number)
    return Estimate(one.key, value, error, one.source, note=one.note)


def flank_counts(seen: Observed, begins: I64, on: bool, before_s: float, after_s: float) -> F64:
    """(cycles, pixels) events of one polarity from before to after each flank."""
    t_us = seen.events["t"].astype(np.int64)
    counts = np.zeros((len(begins), seen.pixels))
    for cycle, begin in enumerate(begins):
        low = int(np.searchsorted(t_us, begin - round(1e6 * before_s)))
        high = int(np.searchsorted(t_us, begin + round(1e6 * after_s)))
        chosen = seen.pixel[low:high][seen.on[low:high] == on]
        counts[cycle] = np.bincount(chosen, minlength=seen.pixels)
    return counts


def _calm_hz(seen: Observed, begins: I64, period_s: float) -> tuple[float, float]:
    """(ON, OFF) events of a pixel long after a flank, Hz."""
    t_us = seen.events["t"].astype(np.int64)
    on = off = 0
    for begin in begins:
        low = int(np.searchsorted(t_us, begin + round(1e6 * AFTER * period_s)))
        high = int(np.searchsorted(t_us, begin + round(1e6 * CALM * period_s)))
        ons = int(np.count_nonzero(seen.on[low:high]))
        on, off = on + ons, off + high - low - ons
    seconds = len(begins) * (CALM - AFTER) * period_s * seen.pixels
    return on / seconds, off / seconds


def _burst_s(seen: Observed, begins: I64, on: bool, calm_hz: float, period_s: float) -> float:
    """How long the events of a flank take, until those that come later anyway are left."""
    times = seen.events["t"][seen.on == on].astype(np.int64)
    offsets = [
        times[np.searchsorted(times, at) : np.searchsorted(times, at + AFTER * 1e6 * period_s)] - at
        for at in begins
    ]
    later = np.sort(np.concatenate(offsets)) * 1e-6
    expected = calm_hz * seen.pixels * len(begins)
    excess = np.arange(1.0, len(later) + 1.0) - expected * later
    # the shortest time within which all but a few of them have come
    enough = (1.0 - LATE) * float(excess.max(initial=0.0))
    first = int(np.argmax(excess >= enough)) if len(later) else 0
    return 1.5 * float(later[first]) + 1e-4 if len(later) else AFTER * period_s


def _counts(seen: Observed, rises: I64, falls: I64, period_s: float) -> tuple[_Counts, Estimate]:
    # the reference has to leak through a whole threshold after a fall, and a part after a rise
    high_hz, low_hz = (_calm_hz(seen, begins, period_s) for begins in (rises, falls))
    parts, bursts = [], []
    # the first cycle begins where the camera happened to rest
    for begins, on, rate in ((rises[1:], True, high_hz[0]), (falls[1:], False, low_hz[1])):
        before_s = BEFORE * period_s
        bursts.append(_burst_s(seen, begins, on, rate, period_s))
        after_s = min(bursts[-1], AFTER * period_s)
        before_s = min(before_s, after_s)
        counts = flank_counts(seen, begins, on, before_s, after_s).mean(axis=0)
        parts.append(counts - rate * (before_s + after_s))
    alive = seen.on_counts + seen.off_counts > 0
    share = 1.0 - float(alive.mean())
    error = math.sqrt(max(share * (1.0 - share), 0.25 / seen.pixels) / seen.pixels)
    dead = Estimate(KEYS[3], share, error, seen.source, note="with those that the light missed")
    means = parts[0][alive], parts[1][alive]
    usual = _inside(means[0]) & _inside(means[1])
    cycles = min(len(rises), len(falls)) - 1
    leak_hz, noise_hz = max(high_hz[0] - high_hz[1], 0.0), high_hz[1] + low_hz[1]
    counts = _Counts(
        means[0][usual], means[1][usual], cycles, leak_hz, noise_hz, 0.5 * period_s, max(bursts)
    )
    return counts, dead


def _inside(values: F64) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    middle = float(np.median(values)) if len(values) else 0.0
    sigma = 1.4826 * float(np.median(np.abs(values - middle))) if len(values) else 0.0
    return np.asarray(np.abs(values - middle) <= OUT * max(sigma, 0.05 * middle, 0.2))


def _thresholds(source: str, counts: _Counts, step: float) -> tuple[Estimate, ...]:
    pixels = len(counts.on)
    few = pixels < 30 or min(counts.on.mean(), counts.off.mean()) < 1.0
    if few:
        reason = "fewer than 30 pixels answer, or with less than one event a flank: more contrast"
        return tuple(cannot(key, source, reason) for key in KEYS[:3])
    on, off = _crude(counts.on, step), _crude(counts.off, step)
    found = _moments(on, off)
    influence = _influence(on, off)
    covariance = influence.T @ influence / pixels**2
    if counts.on.std() < 1e-3 or counts.off.std() < 1e-3:
        return _alike(source, counts, step)
    # a simulation has chance of its own
    weight = np.linalg.inv(covariance * (1.0 + pixels / SIMULATED) + np.diag(found * 1e-3) ** 2)
    point = np.array([step / (counts.on.mean() + 0.5), step / (counts.off.mean() + 0.5), 0.0])
    point[2] = max(float(on.std()), 0.01 * point[0])
    slopes = np.zeros((len(found), 3))
    for _ in range(ROUNDS):
        for k in range(3):
            offset = np.zeros(3)
            offset[k] = STEP * max(point[k], 0.05 * point[0])
            ahead, behind = (_simulated(counts, step, point + s * offset) for s in (1.0, -1.0))
            slopes[:, k] = (ahead - behind) / (2.0 * offset[k])
        gap = found - _simulated(counts, step, point)
        change = np.linalg.lstsq(slopes.T @ weight @ slopes, slopes.T @ weight @ gap, rcond=None)[0]
        point = np.maximum(point + np.clip(change, -0.3 * point, 0.3 * point), 1e-4)
        if np.all(np.abs(change) < 1e-4 * point[0]):
            break
    gap = found - _simulated(counts, step, point)
    # four moments, three parameters: what is left over tells whether the model holds
    misfit = max(1.0, math.sqrt(float(gap @ weight @ gap)))
    errors = misfit * np.sqrt(np.diag(np.linalg.pinv(slopes.T @ weight @ slopes)))
    # what the simulation simplifies: every pixel has the mean leak, and noise comes once at most
    rough = BETWEEN * (counts.leak_hz + counts.noise_hz) * counts.half_s * point[:2] / step + ROUGH
    errors = np.hypot(errors, [*(rough * point[:2]), SPREAD_ROUGH * float(point[2])])
    note = f"counts fit {misfit:.1f} times worse than by chance" if misfit > 4.0 else ""
    return tuple(
        Estimate(key, float(value), float(error), source, note=note).checked()
        for key, value, error in zip(KEYS[:3], point, errors, strict=True)
    )


def _alike(source: str, counts: _Counts, step: float) -> tuple[Estimate, ...]:
    """All pixels have the same counts, so the threshold is known to within one event."""
    found = []
    for key, count in ((KEYS[0], counts.on.mean()), (KEYS[1], counts.off.mean())):
        low, high = step / (count + 1.0), step / count
        note = "all pixels have the same counts, which give its ends only"
        found.append(Estimate(key, 0.5 * (low + high), (high - low) / math.sqrt(12.0), source,
                              note=note))  # fmt: skip
    return *found, cannot(KEYS[2], source, "all pixels have the same counts")


def _crude(count: F64, step: float) -> F64:
    """The threshold but for whole events: near normal over pixels, as the counts are not."""
    return np.asarray(step / (np.maximum(count, 0.0) + 0.5))


def _moments(on: F64, off: F64) -> F64:
    return np.array([on.mean(), off.mean(), on.var(), off.var()])


def _influence(on: F64, off: F64) -> F64:
    """(pixels, 4) what each pixel adds to the moments."""
    a, b = on - on.mean(), off - off.mean()
    return np.stack([a, b, a * a - (a * a).mean(), b * b - (b * b).mean()], axis=1)


def _simulated(counts: _Counts, step: float, point: F64) -> F64:
    """The moments of simulated pixels; the same random numbers for any parameters."""
    draw = np.random.default_rng(1)
    floor = 0.05 * min(point[0], point[1])
    ons = np.maximum(point[0] + point[2] * draw.standard_normal(SIMULATED), floor)
    offs = np.maximum(point[1] + point[2] * draw.standard_normal(SIMULATED), floor)
    # signal less reference
    gap = ons * draw.random(SIMULATED)
    cycles = min(counts.cycles, MOST_CYCLES)
    on = np.zeros(SIMULATED)
    off = np.zeros(SIMULATED)
    leak = counts.leak_hz * counts.half_s
    for cycle in range(-SETTLED_CYCLES, cycles):
        gap += step
        events = np.floor(gap / ons)
        gap -= events * ons
        on += events * (cycle >= 0)
        gap = _rest(gap, ons, leak, counts, draw)
        gap -= step
        events = np.floor(-gap / offs) * (gap <= -offs)
        gap += events * offs
        off += events * (cycle >= 0)
        gap = _rest(gap, ons, leak, counts, draw)
    return _moments(_crude(on / cycles, step), _crude(off / cycles, step))


def _rest(gap: F64, ons: F64, leak: float, counts: _Counts, draw: np.random.Generator) -> F64:
    """Half a period without change: leak, and noise that sets back the reference."""
    chance, late = draw.random(SIMULATED), draw.random(SIMULATED)
    struck = chance < -math.expm1(-counts.noise_hz * counts.half_s)
    leaked = gap + leak * ons
    leaked -= np.maximum(np.floor(leaked / ons), 0.0) * ons
    return np.where(struck, (leak * late % 1.0) * ons, leaked)
