"""The extremes of the sensor: thresholds, blindness, bandwidth, readout, size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from evs.drivers.extremes.curtain import OPEN, SHUT, Shown, curtain
from evs.drivers.extremes.extreme import Extreme, Outcome
from evs.drivers.extremes.size import SIZES
from evs.msgs import Events

READOUT = {
    "order": "arbiter", "row_ns": 500, "column_ns": 83, "jitter_ns": 50.0,
    "bandwidth_mevs": 12.0, "fifo": 8192, "stamp": "read",
}  # fmt: skip
"""[sensor.readout]: a DAVIS346's, its queue short enough to overflow soon"""


def swept(begin: int, length: int, tick: int) -> float:
    """Where the curtain is that is drawn from ticks `begin` on and drawn back, `length` each."""
    shut = min(tick - begin, begin + 2 * length - tick) / length
    return OPEN if shut <= 0 else 2.0 - 4.0 * shut


def _swept(length: int, still: int, sensor: Mapping[str, Any]) -> Shown:
    return curtain(lambda tick: swept(1, length, tick), 1 + 2 * length + still, {"sensor": sensor})


def _thresholds(theta: float, exposure_dn: float, short: bool) -> Outcome:
    """Drawn and drawn back, by pixels of this threshold; afterwards nothing is left untold."""
    sensor = {"pos_thres": theta, "neg_thres": theta, "exposure_dn": exposure_dn}
    if short:
        sensor |= {"width": 12, "height": 8}
    half = curtain(lambda tick: swept(1, 5, min(tick, 6)), 8, {"sensor": sensor})
    whole = _swept(5 if short else 40, 3, sensor)
    worst = max(half.untold(), whole.untold())
    limit = 1.0 + half.rounding()
    # the light is again what it was at first
    on, off = whole.counts()
    settled = not len(whole.film.within((whole.film.report.ticks - 2) * 1000, 10**9))
    return Outcome(
        worst, limit, "thresholds", _said(whole), settled and bool(np.array_equal(on, off))
    )


def _said(shown: Shown) -> tuple[str, ...]:
    """Its warnings, or how many events its report counts."""
    report = shown.film.report
    return shown.film.warnings or (f"{report.events:,} events, {report.events_dropped:,} dropped",)


def _low(short: bool) -> Outcome:
    return _thresholds(0.001, 255.0, short)


def _high(short: bool) -> Outcome:
    return _thresholds(10.0, 1e9, short)


def _spread(short: bool) -> Outcome:
    """Thresholds so unequal that a fifth of them would be below zero."""
    shown = _swept(5 if short else 40, 3, {"sigma_thres": 0.6, "pos_thres": 0.5, "neg_thres": 0.5})
    settled = not len(shown.film.within((shown.film.report.ticks - 2) * 1000, 10**9))
    named = any("sigma_thres" in line for line in shown.film.warnings)
    right = settled and named and shown.least_threshold() == np.float32(0.01)
    return Outcome(shown.untold(), 1.0 + shown.rounding(), "thresholds", _said(shown), right)


def _blind(short: bool) -> Outcome:
    """Blind for 100 s after each event; beside it a pixel whose blindness ends within the run."""
    length = 5 if short else 40
    for_ever = _swept(length, 3, {"refractory_period_s": 100.0})
    named = any("refractory_period_s" in line for line in for_ever.film.warnings)
    on, off = for_ever.counts()
    # blind until the curtain has been drawn: then it sees it drawn back
    for_long = _swept(length, length, {"refractory_period_s": length * 1e-3})
    again = for_long.counts(for_long.film.within(length * 1000, 10**9))[0].astype(bool)
    worst = float((on + off).max()) if on.any() or off.any() else math.nan
    return Outcome(worst, 1, "event(s) a pixel", _said(for_ever), named and bool(again.any()))


def _slow(short: bool) -> Outcome:
    """A pole of 0.01 Hz under a curtain that comes, stays for a while and goes."""
    length = 20 if short else 200
    theta, cutoff_hz, dim_lux = 0.002, 0.01, 1e6
    sensor = {"pos_thres": theta, "neg_thres": theta, "cutoff_hz": cutoff_hz, "dim_lux": dim_lux}
    sensor |= {"width": 8, "height": 6}
    ticks = 1 + 2 * length
    shown = curtain(lambda tick: OPEN if tick < 1 else SHUT, ticks, {"sensor": sensor})
    told = shown.counts()[1]
    # in the dark the pole is at f dim / (bright + dim); the light falls in a line during one tick,
    # so the signal is between those of light that fell at its start and at its end
    z = 2.0 * math.pi * cutoff_hz * dim_lux / (1000.0 + dim_lux) * 1e-3
    change = np.log(255.0) * -np.expm1(-z * np.array([ticks - 2, ticks - 1])) / theta
    off_by = np.abs(told - change.mean()).max()
    limit = 1.0 + 0.5 * float(np.diff(change)[0])
    named = any("cutoff_hz" in line for line in shown.film.warnings)
    # ticks of 1 s: after 20 time constants the pixel has told all
    settles = curtain(
        lambda tick: OPEN if tick < 1 else SHUT,
        100 if short else 400,
        {"sensor": {**sensor, "pos_thres": 0.1, "neg_thres": 0.1},
         "scene": {"tick_us": 1_000_000 * (4 if short else 1)}},
    )  # fmt: skip
    right = named and settles.untold() <= 1.0 + settles.rounding()
    return Outcome(float(off_by), limit, "events a pixel", _said(shown), right)


def _fast(short: bool) -> Outcome:
    """A pole of 1 MHz beside none at all."""
    length, hz = 5 if short else 40, 1e6
    # no level is just where the light comes to rest: that is reached a tick later
    theta = {"pos_thres": 0.23, "neg_thres": 0.2}
    none, fast = (_swept(length, 3, {**theta, "cutoff_hz": cutoff}) for cutoff in (0.0, hz))
    ours, theirs = (_by_pixel(shown.film.events) for shown in (fast, none))
    same = np.array_equal(ours[["y", "x", "p"]], theirs[["y", "x", "p"]])
    late_us = float(np.abs(ours["t"] - theirs["t"]).max()) if same else math.nan
    # in the dark the pole is slowest; stamps are whole us
    dark = fast.sensor.dim_lux / (fast.sensor.bright_lux + fast.sensor.dim_lux)
    limit = 1e6 / (2.0 * math.pi * hz * dark) + 1.0
    return Outcome(late_us, limit, "us", _said(fast), fast.untold() <= 1.0 + fast.rounding())


def _by_pixel(events: Events) -> Events:
    return events[np.lexsort((events["t"], events["x"], events["y"]))]


def _saturated(short: bool) -> Outcome:
    """All pixels black and white in turn, tick by tick, then one calm sweep."""
    flashes, calm = (20, 10) if short else (200, 40)
    rest = flashes + 12

    def left(tick: int) -> float:
        if tick < flashes:
            return SHUT if tick % 2 else OPEN
        return swept(rest, calm, tick)

    ticks = rest + 2 * calm + 4
    ideal = curtain(left, ticks)
    chip = curtain(left, ticks, {"sensor": {"readout": READOUT}})
    report = chip.film.report
    made, out = len(ideal.film.events), len(chip.film.events)
    lost = report.events_dropped
    missing = abs(made - out - lost - report.events_waiting)
    # no more leaves in a millisecond than the link carries
    ends = np.arange(0, ticks * 1000 + 1, 1000)
    busiest = int(np.diff(np.searchsorted(chip.film.events["t"], ends, "right")).max())
    told = report.cameras[0]["events_dropped"]
    said = (f"{made:,} events made, {out:,} read out, dropped: {_causes(told)}",)
    calm_us = rest * 1000
    after, expected = (film.within(calm_us, 10**9) for film in (ideal.film, chip.film))
    right = lost > 0 and busiest <= 12_001 and _same_pixels(after, expected)
    return Outcome(missing, 0, "missing events", said, right)


def _causes(dropped: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {cause}" for cause, count in dropped.items() if count)


def _same_pixels(a: Events, b: Events) -> bool:
    """Whether both have as many events of each pixel and polarity, and some."""
    sorted_a, sorted_b = (np.sort(events[["y", "x", "p"]]) for events in (a, b))
    return len(a) > 0 and bool(np.array_equal(sorted_a, sorted_b))


_PIXEL = (
    "what a pixel has told, its thresholds times its events, is within one threshold of the "
    "light's change"
)

EXTREMES = (
    Extreme(
        "threshold-0.001",
        "sensor",
        "thresholds of 0.001, 5,500 events a pixel from white to black",
        f"{_PIXEL} (and 2^-19, two logarithms' rounding); drawn back, as many ON as OFF",
        _low,
    ),
    Extreme(
        "threshold-10",
        "sensor",
        "thresholds of 10 under a contrast of e^20.7",
        f"{_PIXEL}; drawn back, as many ON as OFF",
        _high,
    ),
    Extreme(
        "sigma-over-theta",
        "sensor",
        "thresholds of 0.5 with a spread of 0.6",
        f"none below 0.01, and {_PIXEL}, its own; a warning says how many are at the floor",
        _spread,
    ),
    Extreme(
        "refractory-beyond-run",
        "sensor",
        "pixels that are blind for 100 s after an event",
        "one event a pixel at most, and a warning; one that is blind for less sees again after it",
        _blind,
    ),
    Extreme(
        "cutoff-0.01-hz",
        "sensor",
        "a photoreceptor with a bandwidth of 0.01 Hz goes dark",
        "events of a pixel: log(255) (1 - e^(-2 pi f t)) / theta, less than 1 away, and half of "
        "those of the tick in which it goes dark; a warning; after 20 time constants all is told",
        _slow,
    ),
    Extreme(
        "cutoff-1-mhz",
        "sensor",
        "a bandwidth of 1 MHz beside none",
        "the same events, late by the pole's 1 / (2 pi f) in the dark, and 1 us: stamps are whole",
        _fast,
    ),
    Extreme(
        "every-pixel-every-tick",
        "sensor",
        "the whole picture black and white in turn, tick by tick, through a DAVIS346's readout",
        "events made = read out + dropped (counted by cause) + waiting; no more than 12 Mev/s out; "
        "what comes afterwards is read out whole",
        _saturated,
    ),
    *SIZES,
)
