"""Thresholds and leak from intensity frames beside the events.

After an event the reference of a pixel is the light of that moment. So between two events of a
pixel ln light has changed by theta_on N_on - theta_off N_off, less the leak, without the rounding
of whole events. Frames give ln light exactly only at their own time, so events count as ends of a
window only if they are near the middle of an exposure. Every pixel has thresholds of its own: a
pixel with low thresholds has more events, so one regression of all pixels would be biased. They
are random effects here, whose variance is the mismatch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from evs.emulator.base.scene import F32
from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.observed import F64, I64, Mask, Observed
from evs_lab.fit.ramp import KEYS

LEAK = "leak_rate_hz"

FEWEST_FRAMES = 8
FEWEST_WINDOWS, FEWEST_PIXELS = 300, 60
NEAR = 0.05
"""of the time between two frames: how far from the middle of an exposure a window may end"""

MOST_PIXELS, MOST_WINDOWS = 10_000, 40
"""pixels that are fitted, by chance, and windows of each: more hardly add to the accuracy"""

FEWEST_EVENTS = 4
"""of a pixel that is fitted, where there are too many"""

USUAL_THRESHOLD, USUAL_DARK = 0.2, 0.0
"""with which light that stands is found, where the thresholds are not told"""

WHITE = 255.0
LEAST, BRIGHTEST = 12.0, 0.92
"""light over the dark level and share of white, outside which a pixel of a frame is not used"""

DARKER = -12.0
"""lowest dark level, of 255: a converter that cuts off"""

ROUGH_DARK = 0.04
"""error of the dark level by what the fit leaves out, of the mean light"""

ROUGH = 0.035
"""relative error of a threshold by curvature of the light between frames and motion blur"""

ROUGH_LEAK = 0.25, 0.35
"""errors of the leak: relative, and for each noise event"""

LONGEST_LAG_S, LAG_DN = 0.02, 100.0
"""how far events may lag behind light of so many DN; the lag is inverse to the light"""

CLEAR = 0.15
"""log units that the windows must span, root mean square"""

ROUNDS, INNER = 6, 3
FAR = 5.0
"""standard deviations beyond which a window is left out"""

MOST_SPREAD = 0.3
"""of a threshold: a larger bound of the mismatch tells nothing"""

STILL = 0.25
"""light of a pixel that moves by this share of a threshold at most stands still"""

MOST_FRAMES = 60
"""that show whether light stands"""

FEWEST_STILL_S = 1000.0
"""pixel seconds of light that stands"""


@dataclass(frozen=True)
class FrameLight:
    """What the frames show of the pixels' light."""

    mid_us: F64
    """(frames,) middles of the exposures"""
    dn: F32
    """(frames, pixels) light, white is 255"""


@dataclass(frozen=True)
class _Windows:
    """From an event near one frame to an event near a later one; arrays of (pixels, windows)."""

    y: F64
    """change of ln light in the frames"""
    x: F64
    """(pixels, windows, 5) ON charge, - OFF charge, - seconds, change of slope, of 1 / light"""
    z: F64
    """the same as instruments: what is not measured by the frames of the window itself"""
    there: F64
    """1: there is such a window"""
    chained: F64
    """1: the next window begins at the frame where this one ends"""
    count: int


@dataclass(frozen=True)
class _Solution:
    beta: F64
    """of the columns"""
    error: F64
    sigma: tuple[float, float]
    """mismatch and its standard error"""
    noise_hz: float
    """events of a pixel that follow from no light"""
    span: float
    """root mean square of the windows' change of ln light"""
    diluted: float
    """share by which the noise of the counts makes the thresholds smaller"""


def frame_light(seen: Observed) -> FrameLight:
    """The frames of the recording's size, in order."""
    frames = [f for f in seen.frames if f.pixels.shape == (seen.height, seen.width)]
    frames.sort(key=lambda f: f.exposure_begin_us)
    mid = np.array([0.5 * (f.exposure_begin_us + f.exposure_end_us) for f in frames])
    keep = np.flatnonzero(np.diff(mid, prepend=-math.inf) > 0)
    white = float(np.iinfo(frames[0].pixels.dtype).max) if frames else WHITE
    dn = np.zeros((len(keep), seen.pixels), np.float32)
    for row, k in zip(dn, keep, strict=True):
        row[:] = frames[k].pixels.reshape(-1) * (WHITE / white)
    return FrameLight(mid[keep], dn)


def standing(dn: F32, dark: float, theta: float) -> Mask:
    """(pixels,) those whose light stands: what moves in their frames is noise.

    Args:
        dn: (frames, pixels) light of the frames, white is 255.
        dark: Dark level of the frames.
        theta: Threshold of the pixels, log units.
    """
    over = dn - dark
    usable = np.all((over >= LEAST) & (dn < BRIGHTEST * WHITE), axis=0)
    # the frames have noise: means of several stand more still
    size = max(len(over) // 6, 2)
    parts = [np.log(np.maximum(over[k : k + size].mean(axis=0), 1.0))
             for k in range(0, len(over) - size + 1, size)]  # fmt: skip
    each = np.log(np.maximum(over, 1.0))
    still = usable & (np.ptp(np.array(parts), axis=0) < STILL * theta)
    still &= np.std(each, axis=0) < 2.0 * STILL * theta
    # what passes quickly hardly moves the means
    return np.asarray(still & (np.abs(each - each.mean(axis=0)).max(axis=0) < theta))


def fit_frames(
    seen: Observed, blind_s: tuple[float, float] = (0.0, 0.0)
) -> tuple[tuple[Estimate, ...], float]:
    """Fit both thresholds, their mismatch and the leak.

    Args:
        seen: A recording with frames, in which the light of many pixels changes slowly.
        blind_s: The time for which a pixel is blind after an event, and its standard error.

    Returns:
        (the estimates, the dark level of the frames, of white 255; 0: not known).
    """
    light = frame_light(seen)
    keys = (*KEYS[:3], LEAK)

    if len(light.mid_us) < FEWEST_FRAMES:
        reason = f"{len(light.mid_us)} intensity frames of its size"
        return tuple(cannot(key, seen.source, reason) for key in keys), USUAL_DARK

    def refuse(reason: str) -> tuple[tuple[Estimate, ...], float]:
        leak = _still_leak(seen, light, USUAL_DARK, USUAL_THRESHOLD)
        leak = leak or cannot(LEAK, seen.source, reason)
        return (*(cannot(key, seen.source, reason) for key in keys[:3]), leak), USUAL_DARK

    fit = _Fit(seen, light, blind_s[0])
    dark, lag_s, dark_error = 0.0, 0.0, 0.0
    found: _Solution | None = None
    for _ in range(ROUNDS):
        windows = fit.windows(dark, lag_s, found)
        if windows is None:
            return refuse("too few events of changing light are near the time of a frame")
        found = fit.solved(windows, 5, found)
        if found is None or found.span < CLEAR:
            return refuse("the light of too few pixels changes enough between frames")
        lag_s = min(max(lag_s + float(found.beta[3]), 0.0), LONGEST_LAG_S)
        step = min(max(float(found.beta[4]), -6.0), 6.0)
        dark = min(max(dark + step, DARKER), fit.darkest - 1.0)
        dark_error = float(found.error[4])
    dark_error = math.hypot(dark_error, ROUGH_DARK * (fit.mean - dark))
    three = []
    for level in (dark, dark - dark_error, min(dark + dark_error, fit.darkest - 0.5)):
        windows = fit.windows(level, lag_s, found)
        one = fit.solved(windows, 3, found) if windows is not None else None
        if one is None:
            return refuse("the fit has no solution")
        three.append(one)
    best = three[0]
    shift = 0.5 * np.abs(three[1].beta[:3] - three[2].beta[:3])
    if not best.beta[:2].min() > 0.0:
        return refuse("frames and events disagree")
    note = f"dark level of the frames {dark:.0f} of 255"
    thresholds = _thresholds(best, shift, fit.blind_share * blind_s[1])
    thresholds = [replace(one, source=seen.source, note=note).checked(0.3) for one in thresholds]
    leak = _still_leak(seen, light, dark, float(best.beta[:2].min()))
    if leak is None:
        leak = _moving_leak(seen, best)
    if not all(one.told for one in thresholds):
        spread = cannot(keys[2], seen.source, "the thresholds cannot be told")
        return (*thresholds, spread, leak), dark
    if leak.told:
        thresholds = _balanced(thresholds, leak, fit.totals(dark), best)
    spread = _spread(seen, best, max(one.error / one.number for one in thresholds))
    return (*thresholds, spread, leak), dark


def _thresholds(best: _Solution, shift: F64, blind: float) -> list[Estimate]:
    """Both thresholds; their change with the dark level, and error by the time of blindness."""
    found = []
    uneven = best.sigma[0] / max(float(best.beta[:2].min()), 1e-3)
    # counts with noise of their own dilute the regression
    rough = math.hypot(ROUGH, 0.7 * best.diluted, 0.5 * uneven * uneven, blind)
    for k in (0, 1):
        value = float(best.beta[k]) * (1.0 + best.diluted)
        error = math.hypot(float(best.error[k]), float(shift[k]), rough * value)
        found.append(Estimate(KEYS[k], value, error))
    return found


def _balanced(
    thresholds: list[Estimate], leak: Estimate, totals: _Totals, best: _Solution
) -> list[Estimate]:
    """The thresholds with the ratio by which all ON and all OFF events match light and leak.

    Windows tell the size of the thresholds, but each has few events; the totals tell the ratio. The
    errors stay: most of them is common to both thresholds.
    """
    on, off = thresholds
    light = totals.change + on.number * leak.number * totals.seconds
    least = min(on.number * totals.ons, off.number * totals.offs)
    if least <= abs(light):
        return thresholds
    relative = [one.error / one.number for one in thresholds]
    both = relative[0] ** 2 + relative[1] ** 2
    noise = math.hypot(
        best.sigma[0] * math.sqrt(totals.squares),
        0.5 * on.number * math.sqrt(totals.pixels),
        on.number * leak.error * totals.seconds,
        max(relative) * light,
    )
    trust = both / (both + ROUGH**2 + (noise / least) ** 2)
    # by how much off / on has to grow
    shift = trust * math.log((on.number * totals.ons - light) / (off.number * totals.offs))
    return [
        replace(on, value=on.number * math.exp(-shift * relative[0] ** 2 / both)),
        replace(off, value=off.number * math.exp(shift * relative[1] ** 2 / both)),
    ]


def _spread(seen: Observed, best: _Solution, relative: float) -> Estimate:
    """The mismatch; the thresholds have this relative error."""
    sigma, own = best.sigma
    own = math.hypot(own, sigma * relative, ROUGH * sigma)
    if sigma >= 2.0 * own:
        return Estimate(KEYS[2], sigma, own, seen.source).checked()
    if sigma + own > MOST_SPREAD * float(best.beta[:2].min()):
        return cannot(KEYS[2], seen.source, "too few pixels have several windows")
    return Estimate(KEYS[2], 0.0, sigma + own, seen.source, note="no spread shows")


def _moving_leak(seen: Observed, best: _Solution) -> Estimate:
    """The leak by which the charges of ON events exceed those of the light."""
    on, off, drift = (float(best.beta[k]) for k in range(3))
    value = drift / on
    relative, by_noise = ROUGH_LEAK
    # noise events of both polarities have different charges, and none by the light
    noise = best.noise_hz * (by_noise + 0.5 * abs(1.0 - off / on))
    error = math.hypot(float(best.error[2]) / on, relative * value, noise)
    if value < 2.0 * error:
        reason = f"leak is {value:.2g} +- {error:.2g} Hz where the light moves, and nowhere stands"
        return cannot(LEAK, seen.source, reason)
    return Estimate(LEAK, value, error, seen.source, note="with its hot tail, in moving light")


def _still_leak(seen: Observed, light: FrameLight, dark: float, theta: float) -> Estimate | None:
    """The leak by the ON events of pixels whose light stands; None: there are too few of them."""
    some = np.linspace(0.0, len(light.dn) - 1.0, min(len(light.dn), MOST_FRAMES)).astype(np.int64)
    still = standing(light.dn[some], dark, theta)
    seconds = seen.seconds
    count = int(still.sum())
    ons, offs = seen.on_counts[still], seen.off_counts[still]
    if count * seconds < FEWEST_STILL_S:
        return None
    excess = (ons - offs) / seconds
    value = float(excess.mean())
    error = math.hypot(float(excess.std(ddof=1)) / math.sqrt(count), ROUGH * value)
    # noise sets back the reference: of a leak L, s / (e^(s / L) - 1) is left in noise of a rate s
    noise = 2.0 * float(offs.mean()) / seconds
    if value > 2.0 * error and noise > 0.0:
        whole = noise / math.log1p(noise / value)
        error = math.hypot(error * whole / value, 0.3 * (whole - value))
        value = whole
    note = f"with its hot tail, of {count} pixels whose light stands"
    if value < 2.0 * error:
        most = max(value, 0.0) + error
        # as much again where noise sets it back
        most = noise / math.log1p(noise / most) if noise > 0.0 else most
        return Estimate(LEAK, 0.0, most, seen.source, note=f"no leak shows, {note}")
    return Estimate(LEAK, value, error, seen.source, note=note)


@dataclass(frozen=True)
class _Totals:
    """Of all pixels, from the first frame that shows their light to the last."""

    ons: float
    offs: float
    """charges of ON and of OFF events"""
    change: float
    """of ln light"""
    seconds: float
    squares: float
    """sum over pixels of the squared charges of both polarities"""
    pixels: int


class _Fit:
    """Windows and their regression."""

    def __init__(self, seen: Observed, light: FrameLight, blind_s: float) -> None:
        order = seen.order
        pixel = seen.pixel[order]
        dn = light.dn
        if seen.pixels > MOST_PIXELS:
            busy = np.flatnonzero(seen.on_counts + seen.off_counts >= FEWEST_EVENTS)
            chosen = np.sort(np.random.default_rng(0).permutation(busy)[:MOST_PIXELS])
            number = np.full(seen.pixels, -1)
            number[chosen] = np.arange(len(chosen))
            kept = number[pixel] >= 0
            order, pixel, dn = order[kept], number[pixel[kept]], dn[:, chosen]
        self._mid, self._dn, self._pixel = light.mid_us, dn.astype(np.float64), pixel
        self._t_us = seen.events["t"][order].astype(np.float64)
        on = seen.on[order]
        same = np.flatnonzero((np.diff(pixel) == 0) & (on[1:] == on[:-1])) + 1
        passed = 1e-6 * (self._t_us[same] - self._t_us[same - 1])
        # what passes while a pixel is blind is lost
        charge = np.ones(len(pixel))
        seeing = np.maximum(passed - blind_s, passed / 3.0 + 1e-7)
        charge[same] = np.clip(passed / seeing, 1.0, 3.0)
        self._on, self._off = np.cumsum(charge * on), np.cumsum(charge * ~on)
        self.blind_share = float(np.mean(1.0 / np.maximum(passed, 1e-4))) if len(passed) else 0.0
        """1 / s: by how much the charges grow with the time for which pixels are blind"""
        self.darkest = float(np.quantile(self._dn, 1e-3)) if self._dn.size else 0.0
        self.mean = float(self._dn.mean()) if self._dn.size else 0.0

    def windows(self, dark: float, lag_s: float, before: _Solution | None) -> _Windows | None:
        """Those of all pixels, for a dark level and a lag."""
        mid, dn, pixel = self._mid, self._dn, self._pixel
        over = np.maximum(dn - dark, 1.0)
        good = (dn - dark >= LEAST) & (dn <= BRIGHTEST * WHITE)
        usable = np.zeros_like(good)
        usable[1:-1] = good[1:-1] & good[2:] & good[:-2]
        frame = _nearest(mid, self._t_us)
        t_us = self._t_us - 1e6 * lag_s * LAG_DN / np.maximum(over[frame, pixel], LEAST)
        frame = _nearest(mid, t_us)
        far = np.abs(t_us - mid[frame])
        near = np.flatnonzero((far <= NEAR * float(np.median(np.diff(mid)))) & usable[frame, pixel])
        place = pixel[near] * len(mid) + frame[near]
        by_place = np.lexsort((far[near], place))
        ends = np.sort(near[by_place[np.diff(place[by_place], prepend=-1) > 0]])
        at, of, when = frame[ends], pixel[ends], t_us[ends]
        logs = np.log(over)
        other = np.where(when > mid[at], at + 1, at - 1)
        part = (when - mid[at]) / (mid[other] - mid[at])
        level = logs[at, of] + part * (logs[other, of] - logs[at, of])
        seconds = 1e-6 * (mid[at + 1] - mid[at - 1])
        slope = (logs[at + 1, of] - logs[at - 1, of]) / seconds * LAG_DN / over[at, of]
        first = np.flatnonzero(np.diff(of) == 0)
        last = first + 1
        if len(first) < FEWEST_WINDOWS:
            return None
        ons = self._on[ends[last]] - self._on[ends[first]]
        offs = self._off[ends[last]] - self._off[ends[first]]
        duration = 1e-6 * (when[last] - when[first])
        theta = np.array([0.25, 0.25, 0.0]) if before is None else before.beta[:3]
        charge = theta[0] * ons - theta[1] * offs - theta[2] * duration
        middle = np.sqrt(over[at, of][first] * over[at, of][last])
        slopes = slope[last] - slope[first]
        inverse = 1.0 / over[at, of][last] - 1.0 / over[at, of][first]
        # a wrong level at an end is in ln light and in 1 / light: the charge has no part in it
        x = np.stack([ons, -offs, -duration, slopes, inverse], axis=1)
        z = np.stack([ons, -offs, -duration, slopes, -charge / middle], axis=1)
        return _padded(of[first], first, level[last] - level[first], x, z)

    def totals(self, dark: float) -> _Totals:
        """What ON and OFF events have to balance, for a dark level of the frames."""
        over = self._dn - dark
        good = (over >= LEAST) & (self._dn <= BRIGHTEST * WHITE)
        # means of two frames have less noise
        good, logs = good[1:] & good[:-1], np.log(np.maximum(0.5 * (over[1:] + over[:-1]), 1.0))
        middle = 0.5 * (self._mid[1:] + self._mid[:-1])
        first, last = good.argmax(axis=0), len(good) - 1 - good[::-1].argmax(axis=0)
        chosen = np.flatnonzero(good.any(axis=0) & (last > first))
        begin, end = middle[first], middle[last]
        inside = (self._t_us > begin[self._pixel]) & (self._t_us <= end[self._pixel])
        pixels = self._dn.shape[1]
        sums = [
            np.bincount(self._pixel[inside], np.diff(of, prepend=0.0)[inside], minlength=pixels)
            for of in (self._on, self._off)
        ]
        ons, offs = (each[chosen] for each in sums)
        change = logs[last[chosen], chosen] - logs[first[chosen], chosen]
        return _Totals(
            float(ons.sum()),
            float(offs.sum()),
            float(change.sum()),
            1e-6 * float((end - begin)[chosen].sum()),
            float((ons**2 + offs**2).sum()),
            len(chosen),
        )

    def solved(self, of: _Windows, columns: int, before: _Solution | None) -> _Solution | None:
        """Generalised least squares with thresholds of each pixel as random effects."""
        x, z, y, there = of.x[:, :, :columns], of.z[:, :, :columns], of.y, of.there
        if len(y) < FEWEST_PIXELS:
            return None
        on, off, seconds = of.x[:, :, 0], of.x[:, :, 1], np.abs(of.x[:, :, 2])
        squares = on**2 + off**2
        count = y.shape[1]
        diagonal = np.arange(count)
        frame2, walk2 = 0.05**2, 1e-3
        sigma2 = (0.02 if before is None else before.sigma[0]) ** 2
        good, beta, sigma_error, drift2 = there.copy(), np.zeros(columns), 0.0, 0.0
        scores, bread = np.zeros((len(y), columns)), np.eye(columns)
        for _ in range(INNER):
            covariance = sigma2 * (
                on[:, :, None] * on[:, None, :] + off[:, :, None] * off[:, None, :]
            )
            covariance += drift2 * seconds[:, :, None] * seconds[:, None, :]
            variance = 2.0 * frame2 + walk2 * seconds
            covariance[:, diagonal, diagonal] += variance + 1e6 * (1.0 - good)
            pairs = of.chained[:, :-1] * good[:, :-1] * good[:, 1:]
            covariance[:, diagonal[:-1], diagonal[1:]] -= frame2 * pairs
            covariance[:, diagonal[1:], diagonal[:-1]] -= frame2 * pairs
            weighted = np.linalg.solve(covariance, np.concatenate([x, y[:, :, None]], axis=2))
            each = np.einsum("bmp,bmq->bpq", z, weighted[:, :, :-1])
            right = np.einsum("bmp,bm->bp", z, weighted[:, :, -1])
            try:
                bread = np.linalg.inv(each.sum(axis=0))
            except np.linalg.LinAlgError:
                return None
            beta = bread @ right.sum(axis=0)
            scores = right - each @ beta
            left = (y - x @ beta) * there
            usual = variance + sigma2 * squares + drift2 * seconds**2
            good = there * (left**2 < FAR**2 * usual)
            pairs = of.chained[:, :-1] * good[:, :-1] * good[:, 1:]
            sigma2, sigma_error, drift2 = _mismatch(
                left * good, (on * good, off * good), seconds * good, pairs
            )
            shared = left[:, :-1] * left[:, 1:] - sigma2 * (
                on[:, :-1] * on[:, 1:] + off[:, :-1] * off[:, 1:]
            )
            total = float(pairs.sum())
            frame2 = max(-float((shared * pairs).sum()) / max(total, 1.0), 1e-5)
            known = 2.0 * frame2 + sigma2 * squares + drift2 * seconds**2
            walk2 = _walk(left, known, seconds, there > 0.0)
        if not np.all(np.isfinite(beta)):
            return None
        errors = np.sqrt(np.diag(bread @ (scores.T @ scores) @ bread.T))
        sigma = math.sqrt(sigma2)
        theta2 = max(float(np.mean(beta[:2] ** 2)), 1e-6)
        noise_hz = walk2 / (0.6 * theta2)
        net = (on * beta[0] + off * beta[1]) ** 2 / theta2
        inside = good > 0.0
        diluted = noise_hz * float(seconds[inside].mean()) / max(float(net[inside].mean()), 1e-3)
        return _Solution(
            beta,
            np.asarray(errors, np.float64),
            (sigma, sigma_error / max(2.0 * sigma, 1e-3)),
            noise_hz,
            float(np.sqrt(np.mean(y[inside] ** 2))),
            min(diluted, 1.0),
        )


def _nearest(mid: F64, t_us: F64) -> I64:
    """The frame that is nearest in time."""
    after = np.clip(np.searchsorted(mid, t_us), 1, len(mid) - 1)
    return np.asarray(np.where(t_us - mid[after - 1] < mid[after] - t_us, after - 1, after))


def _padded(pixel: I64, first: I64, y: F64, x: F64, z: F64) -> _Windows:
    """The windows of each pixel in a row of their own."""
    starts = np.flatnonzero(np.diff(pixel, prepend=-1) != 0)
    counts = np.diff(np.append(starts, len(pixel)))
    column = np.arange(len(pixel)) - np.repeat(starts, counts)
    row = np.repeat(np.arange(len(starts)), counts)
    kept = column < MOST_WINDOWS
    shape = len(starts), min(MOST_WINDOWS, int(counts.max()))

    def pad(values: F64) -> F64:
        out = np.zeros(shape + values.shape[1:])
        out[row[kept], column[kept]] = values[kept]
        return out

    following = (np.diff(pixel, append=-1) == 0) & (np.diff(first, append=-1) == 1)
    there, chained = pad(np.ones(len(y))), pad(following.astype(np.float64))
    return _Windows(pad(y), pad(x), pad(z), there, chained, len(y))


def _mismatch(
    left: F64, charges: tuple[F64, F64], seconds: F64, pairs: F64
) -> tuple[float, float, float]:
    """Variance of the thresholds, its standard error, and variance of the leak, (log units / s)^2.

    By products of windows of a pixel that share no frame, whose noise is then none of theirs.
    """

    def apart(values: F64) -> F64:
        every = values.sum(axis=1) ** 2 - (values**2).sum(axis=1)
        chained: F64 = (values[:, :-1] * values[:, 1:] * pairs).sum(axis=1)
        return np.asarray(every - 2.0 * chained, np.float64)

    shared, expected, drifts = apart(left), apart(charges[0]) + apart(charges[1]), apart(seconds)
    some = expected > 0.0
    if not some.any():
        return 0.0, math.inf, 0.0
    weight = 1.0 / (1.0 + np.maximum(expected, 0.0) / float(np.median(expected[some])))
    terms = np.stack([expected, drifts], axis=1)
    # the same weight for both: a few pixels with many events decide nothing
    bread = np.linalg.pinv((terms * weight[:, None] ** 2).T @ terms)
    variance, drift = bread @ ((terms * weight[:, None] ** 2).T @ shared)
    if drift < 0.0:
        whole = float((weight * expected).sum())
        variance, drift = float((weight * shared).sum()) / whole, 0.0
        scores = weight * (shared - variance * expected)
        error = float(np.sqrt((scores**2).sum())) / whole
    else:
        each = terms * (weight**2 * (shared - terms @ [variance, drift]))[:, None]
        error = math.sqrt((bread @ (each.T @ each) @ bread)[0, 0])
    return max(float(variance), 0.0), error, float(drift)


def _walk(left: F64, known: F64, seconds: F64, there: Mask) -> float:
    """Variance a second that noise events add: the median of the squares is that of chance."""
    squares, base, each = left[there] ** 2, known[there], seconds[there]
    low, high = 1e-6, 10.0
    for _ in range(24):
        middle = math.sqrt(low * high)
        if float(np.median(squares / (base + middle * each))) > 0.455:
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)
