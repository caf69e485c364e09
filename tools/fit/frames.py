"""Thresholds from intensity frames beside the events: differences of ln light against event counts.

After an event the reference of a pixel is the light of that moment. So between two events of a
pixel ln light has changed by theta_on N_on - theta_off N_off, less the leak, without the rounding
of whole events. The frames give ln light at both moments, by a straight line between two frames.
"""

from __future__ import annotations

import math

import numpy as np

from evs.tools.fit.estimate import Estimate, cannot
from evs.tools.fit.observed import F64, Observed
from evs.tools.fit.ramp import KEYS

FEWEST_FRAMES = 5
WINDOW_FRAMES = (2, 4, 8, 16)
"""lengths of windows that are tried: long ones have more contrast, short ones are more"""

DARKEST, BRIGHTEST = 0.04, 0.95
"""shares of white outside which a pixel of a frame is not used: black level, saturation"""

FEWEST_WINDOWS = 200
LINEAR = 0.02
"""relative error of taking the numbers of a frame for light: black level, curvature"""

NOISE_WEIGHT = 0.7
"""relative error of a threshold for each share of the events that is noise"""

CLEAR = 0.25
"""log units that the windows must span, root mean square"""


def fit_frames(seen: Observed, noise_hz: float = 0.0) -> tuple[Estimate, ...]:
    """Fit both thresholds and their mismatch.

    Args:
        seen: A recording with frames, in which the light of many pixels changes slowly.
        noise_hz: Noise events of a pixel, both polarities; they count without moving the light.
    """
    frames = [f for f in seen.frames if f.pixels.shape == (seen.height, seen.width)]
    if len(frames) < FEWEST_FRAMES:
        reason = f"{len(frames)} intensity frames of its size"
        return tuple(cannot(key, seen.source, reason) for key in KEYS[:3])
    times, logs = _levels(seen)
    noise = min(noise_hz * seen.pixels * seen.seconds / len(seen.events), 1.0)
    best: tuple[Estimate, ...] = ()
    reason = "the light of too few pixels changes enough between events"
    for length in WINDOW_FRAMES:
        if length > len(times) // 2:
            break
        rows = _windows(seen, times, logs, length)
        if len(rows) < FEWEST_WINDOWS or float(np.sqrt(np.mean(rows[:, 0] ** 2))) < CLEAR:
            continue
        found = _regressed(seen, rows, noise)
        if not best or found[0].error < best[0].error:
            best = found
    return best or tuple(cannot(key, seen.source, reason) for key in KEYS[:3])


def _levels(seen: Observed) -> tuple[F64, F64]:
    """(frames,) middles of the exposures, us, and (frames, pixels) ln of the light; NaN: unfit."""
    frames = [f for f in seen.frames if f.pixels.shape == (seen.height, seen.width)]
    frames.sort(key=lambda f: f.exposure_begin_us)
    times = np.array([0.5 * (f.exposure_begin_us + f.exposure_end_us) for f in frames])
    white = float(np.iinfo(frames[0].pixels.dtype).max)
    logs = np.full((len(frames), seen.pixels), np.nan)
    for k, frame in enumerate(frames):
        dn = frame.pixels.reshape(-1).astype(np.float64)
        good = (dn >= DARKEST * white) & (dn <= BRIGHTEST * white)
        logs[k, good] = np.log(dn[good])
    keep = np.concatenate([[True], np.diff(times) > 0])
    return times[keep], logs[keep]


def _windows(seen: Observed, times: F64, logs: F64, length: int) -> F64:
    """(windows, 5): change of ln light, ON events, OFF events, seconds, pixel."""
    order = seen.order
    t_us = seen.events["t"][order].astype(np.float64)
    pixel, on = seen.pixel[order], seen.on[order]
    place = np.searchsorted(times, t_us, side="right") - 1
    inside = (place >= 0) & (place < len(times) - 1)
    at = np.clip(place, 0, len(times) - 2)
    part = (t_us - times[at]) / (times[at + 1] - times[at])
    level = (1.0 - part) * logs[at, pixel] + part * logs[at + 1, pixel]
    inside &= np.isfinite(level)
    # a window is a pixel's events in so many intervals between frames
    window = pixel * (len(times) + length) + place // length
    ons, offs = np.cumsum(on), np.cumsum(~on)
    good = np.flatnonzero(inside)
    edges = np.flatnonzero(np.diff(window[good], prepend=-1, append=-1))
    first, last = good[edges[:-1]], good[edges[1:] - 1]
    two = last > first
    first, last = first[two], last[two]
    rows = np.stack([
        level[last] - level[first],
        ons[last] - ons[first],
        offs[last] - offs[first],
        1e-6 * (t_us[last] - t_us[first]),
        pixel[first],
    ], axis=1)  # fmt: skip
    return np.asarray(rows, np.float64)


def _regressed(seen: Observed, rows: F64, noise_share: float) -> tuple[Estimate, ...]:
    y, pixel = rows[:, 0], rows[:, 4].astype(np.int64)
    x = rows[:, 1:4] * np.array([1.0, -1.0, -1.0])
    weight = np.ones(len(y))
    solution, spread, noise = np.zeros(3), 0.0, np.float64(0.0)
    for _ in range(4):
        scaled = x * weight[:, None]
        solution = np.linalg.lstsq(scaled.T @ x, scaled.T @ y, rcond=None)[0]
        left = y - x @ solution
        # frames have noise of their own; mismatch adds some for every event
        squares = rows[:, 1] ** 2 + rows[:, 2] ** 2
        usual = np.abs(left) < 6.0 * 1.4826 * np.median(np.abs(left)) + 1e-9
        terms = np.stack([np.ones(len(y)), squares], axis=1)[usual]
        noise, per_event = np.linalg.lstsq(terms, left[usual] ** 2, rcond=None)[0]
        spread = math.sqrt(max(float(per_event), 0.0))
        weight = usual / np.maximum(max(float(noise), 1e-8) + spread**2 * squares, 1e-8)
    scaled = x * weight[:, None]
    bread = np.linalg.pinv(scaled.T @ x)
    # the windows of a pixel share its thresholds
    scores = np.zeros((seen.pixels, 3))
    np.add.at(scores, pixel, scaled * (y - x @ solution)[:, None])
    errors = np.sqrt(np.diag(bread @ (scores.T @ scores) @ bread))
    found = []
    for key, value, error in zip(KEYS[:2], solution[:2].tolist(), errors[:2].tolist(), strict=True):
        if not value > 0.0:
            found.append(cannot(key, seen.source, "frames and events disagree"))
            continue
        # pixels with low thresholds have more events, so they count more
        uneven = min((spread / value) ** 2, 0.2)
        value *= 1.0 + uneven
        error = math.hypot(
            error, 0.5 * uneven * value, NOISE_WEIGHT * noise_share * value, LINEAR * value
        )
        found.append(Estimate(key, value, error, seen.source).checked(0.3))
    count = float(np.mean(rows[:, 1] + rows[:, 2]))
    own = spread * 0.15 + math.sqrt(float(noise) if noise > 0.0 else 0.0) / max(count, 1.0) / 10.0
    if all(one.told for one in found):
        found.append(Estimate(KEYS[2], spread, own, seen.source).checked())
    else:
        found.append(cannot(KEYS[2], seen.source, "the thresholds cannot be told"))
    return tuple(found)
