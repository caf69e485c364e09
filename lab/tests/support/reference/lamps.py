"""Light for `evs fit`: lens cap, ramp, blinking lamp; and an event pixel after ESIM."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import evs
from evs.msgs import make_events
from evs_lab.fit import Observed

WIDTH, HEIGHT = 64, 48
WARM_S = 10.0
"""so that a recording begins in the middle of the pixels' life"""


def ramp_frames(contrast: float, period_s: float, periods: int, bright_lux: float, steps: int = 8):
    """(lux, us): the logarithm rises for half of a period and falls for the other."""
    for k in range(2 * steps * periods + 1):
        place = k % (2 * steps)
        share = place / steps if place <= steps else 2.0 - place / steps
        yield bright_lux * contrast ** (share - 1.0), round(k * period_s * 5e5 / steps)


def lamp_frames(contrast: float, period_s: float, periods: int, bright_lux: float):
    """(lux, us): dark for half of a period, then bright; a flank takes 10 us."""
    half_us = round(5e5 * period_s)
    late_us = sorted({int(50 * 1.2**k) for k in range(52) if 50 * 1.2**k < half_us - 20})
    yield bright_lux / contrast, 0
    for half in range(2 * periods):
        lux = bright_lux if half % 2 else bright_lux / contrast
        begin = half * half_us
        if half:
            yield lux, begin
            yield from ((lux, begin + late) for late in late_us)
        yield lux, begin + half_us - 10


def recorded(
    frames: Iterator[tuple[float, int]], seed: int, source: str, begin_s: float = 0.0, **keys: Any
) -> Observed:
    """The events of evs.Pixels from `begin_s` on."""
    pixels = evs.Pixels("ideal", size=(WIDTH, HEIGHT), unit="lux", seed=seed, **keys)
    parts = []
    for lux, t_us in frames:
        events = pixels.observe(np.full((HEIGHT, WIDTH), lux, np.float32), t_us)
        if t_us > 1e6 * begin_s:
            parts.append(events)
    return Observed(np.concatenate([*parts, pixels.finish()]), WIDTH, HEIGHT, source)


def dark(seconds: float, seed: int, lux: float = 0.0, **keys: Any) -> Observed:
    """A lens cap, or a still view."""
    every = ((lux, 100_000 * k) for k in range(int((WARM_S + seconds) * 10) + 1))
    return recorded(every, seed, "dark", WARM_S, **keys)


def ramp(seed: int, contrast: float = 4.0, periods: int = 10, **keys: Any) -> Observed:
    """Light whose logarithm is a triangle, 1 Hz."""
    return recorded(ramp_frames(contrast, 1.0, periods, 600.0), seed, "ramp", **keys)


def lamp(seed: int, contrast: float = 8.0, periods: int = 15, **keys: Any) -> Observed:
    """A lamp of 800 lux that blinks at 1 Hz."""
    return recorded(lamp_frames(contrast, 1.0, periods, 800.0), seed, "lamp", **keys)


Step = Callable[[np.ndarray[Any, Any], float], None]


def esim(
    frames: Iterator[tuple[float, int]],
    on: np.ndarray[Any, Any],
    off: np.ndarray[Any, Any],
    refractory_us: float = 0.0,
) -> Observed:
    """Events after the principle of ESIM (Rebecq et al., CoRL 2018), one pixel at a time in NumPy.

    Log light is a straight line between two frames; each time it has moved by a threshold from the
    level of the last event there is an event, at the line's own time. A pixel that had one within
    the refractory period stays silent, and its level moves on. No code is shared with evs.
    """
    events: list[tuple[int, int, int]] = []
    level = before = None
    last = np.full(len(on), -np.inf)
    for lux, t_us in frames:
        now = math.log(lux)
        if level is None or before is None:
            level, before, then = np.full(len(on), now), now, t_us
            continue
        rising = now > before
        step = on if rising else -off
        count = np.maximum(np.floor((now - level) / step + 1e-12), 0).astype(int)
        for n in range(1, int(count.max(initial=0)) + 1):
            who = np.flatnonzero(count >= n)
            value = level[who] + n * step[who]
            at = then + (value - before) / (now - before) * (t_us - then)
            heard = at - last[who] >= refractory_us
            last[who[heard]] = at[heard]
            stamps = np.ceil(at[heard]).astype(int)
            events += [(t, int(i), int(rising)) for t, i in zip(stamps, who[heard], strict=True)]
        level = level + count * step
        before, then = now, t_us
    t, place, polarity = np.array(sorted(events)).T
    made = make_events(t, place % WIDTH, place // WIDTH, polarity)
    return Observed(made, WIDTH, HEIGHT, "esim")
