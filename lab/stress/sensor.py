"""Stress cases of the sensor: its thresholds, bandwidth, readout and size."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from evs.emulator.base.memory_limits import address_space
from evs.emulator.evsnet.network_files import load_network
from evs.emulator.evsnet.weights import NetworkWeights
from evs.msgs import Events, EvsError
from evs_lab.stress.step_target import (
    OPEN,
    SHUT,
    capture_step,
    capture_sweep,
    edge_position,
    messages_of,
)
from evs_lab.stress.stress_case import Measurement, StressCase


def _thresholds(theta: float, exposure_dn: float, short: bool) -> Measurement:
    """Move the plate in and out; the events of each pixel must explain the change of its light."""
    sensor = {"pos_thres": theta, "neg_thres": theta, "exposure_dn": exposure_dn}
    if short:
        sensor |= {"width": 12, "height": 8}
    half = capture_step(lambda tick: edge_position(1, 5, min(tick, 6)), 8, {"sensor": sensor})
    swept = capture_sweep(5 if short else 40, 3, sensor)
    worst = max(half.residual_thresholds(), swept.residual_thresholds())
    limit = 1.0 + half.rounding()
    # the light is again what it was at first
    on, off = swept.counts()
    settled = not len(swept.capture.within((swept.capture.report.ticks - 2) * 1000, 10**9))
    return Measurement(
        worst, limit, "thresholds", messages_of(swept), settled and bool(np.array_equal(on, off))
    )


def _low(short: bool) -> Measurement:
    return _thresholds(0.001, 255.0, short)


def _high(short: bool) -> Measurement:
    return _thresholds(10.0, 1e9, short)


def _spread(short: bool) -> Measurement:
    """Thresholds with such a spread that a fifth of them would be negative."""
    shown = capture_sweep(
        5 if short else 40, 3, {"sigma_thres": 0.6, "pos_thres": 0.5, "neg_thres": 0.5}
    )
    settled = not len(shown.capture.within((shown.capture.report.ticks - 2) * 1000, 10**9))
    named = any("sigma_thres" in line for line in shown.capture.warnings)
    right = settled and named and shown.least_threshold() == np.float32(0.01)
    return Measurement(
        shown.residual_thresholds(), 1.0 + shown.rounding(), "thresholds", messages_of(shown), right
    )


def _blind(short: bool) -> Measurement:
    """A refractory period of 100 s, and one that ends within the run."""
    length = 5 if short else 40
    for_ever = capture_sweep(length, 3, {"refractory_period_s": 100.0})
    named = any("refractory_period_s" in line for line in for_ever.capture.warnings)
    on, off = for_ever.counts()
    # blind until the plate has moved in: then it sees it move out
    for_long = capture_sweep(length, length, {"refractory_period_s": length * 1e-3})
    again = for_long.counts(for_long.capture.within(length * 1000, 10**9))[0].astype(bool)
    worst = float((on + off).max()) if on.any() or off.any() else math.nan
    unit = "event per pixel" if worst == 1 else "events per pixel"
    return Measurement(worst, 1, unit, messages_of(for_ever), named and bool(again.any()))


_PIXEL = (
    "for each pixel, ON minus OFF events times its threshold is within one threshold of the change "
    "in log light"
)
_REVERSED = "the change back gives as many ON events as there were OFF events"


def _slow(short: bool) -> Measurement:
    """A pole of 0.01 Hz while the plate moves in and stays."""
    length = 20 if short else 200
    theta, cutoff_hz, dim_lux = 0.002, 0.01, 1e6
    sensor = {"pos_thres": theta, "neg_thres": theta, "cutoff_hz": cutoff_hz, "dim_lux": dim_lux}
    sensor |= {"width": 8, "height": 6}
    ticks = 1 + 2 * length
    shown = capture_step(lambda tick: OPEN if tick < 1 else SHUT, ticks, {"sensor": sensor})
    counted = shown.counts()[1]
    # in the dark the pole is at f dim / (bright + dim); the light falls in a line during one tick,
    # so the signal is between those of light that fell at its start and at its end
    z = 2.0 * math.pi * cutoff_hz * dim_lux / (1000.0 + dim_lux) * 1e-3
    change = np.log(255.0) * -np.expm1(-z * np.array([ticks - 2, ticks - 1])) / theta
    off_by = np.abs(counted - change.mean()).max()
    limit = 1.0 + 0.5 * float(np.diff(change)[0])
    named = any("cutoff_hz" in line for line in shown.capture.warnings)
    # ticks of 1 s: after 20 time constants the pixel has settled
    settles = capture_step(
        lambda tick: OPEN if tick < 1 else SHUT,
        100 if short else 400,
        {"sensor": {**sensor, "pos_thres": 0.1, "neg_thres": 0.1},
         "scene": {"tick_us": 1_000_000 * (4 if short else 1)}},
    )  # fmt: skip
    right = named and settles.residual_thresholds() <= 1.0 + settles.rounding()
    return Measurement(float(off_by), limit, "events per pixel", messages_of(shown), right)


def _fast(short: bool) -> Measurement:
    """Compare a pole of 1 MHz with none."""
    length, hz = 5 if short else 40, 1e6
    # no level coincides with the light at rest, which a pole reaches a tick later
    theta = {"pos_thres": 0.23, "neg_thres": 0.2}
    none, fast = (capture_sweep(length, 3, {**theta, "cutoff_hz": cutoff}) for cutoff in (0.0, hz))
    ours, theirs = (_by_pixel(shown.capture.events) for shown in (fast, none))
    same = np.array_equal(ours[["y", "x", "p"]], theirs[["y", "x", "p"]])
    late_us = float(np.abs(ours["t"] - theirs["t"]).max()) if same else math.nan
    # in the dark the pole is slowest; stamps are whole us
    dark = fast.sensor.dim_lux / (fast.sensor.bright_lux + fast.sensor.dim_lux)
    limit = 1e6 / (2.0 * math.pi * hz * dark) + 1.0
    return Measurement(
        late_us, limit, "us", messages_of(fast), fast.residual_thresholds() <= 1.0 + fast.rounding()
    )


def _by_pixel(events: Events) -> Events:
    return events[np.lexsort((events["t"], events["x"], events["y"]))]


READOUT = {
    "order": "arbiter", "row_ns": 500, "column_ns": 83, "jitter_ns": 50.0,
    "bandwidth_mevs": 12.0, "fifo": 8192, "stamp": "read",
}  # fmt: skip
"""[sensor.readout]: a DAVIS346's, its queue short enough to overflow soon"""


def _saturated(short: bool) -> Measurement:
    """Alternate black and white each tick, then one slow sweep."""
    flashes, calm = (20, 10) if short else (200, 40)
    rest = flashes + 12

    def left(tick: int) -> float:
        if tick < flashes:
            return SHUT if tick % 2 else OPEN
        return edge_position(rest, calm, tick)

    ticks = rest + 2 * calm + 4
    ideal = capture_step(left, ticks)
    chip = capture_step(left, ticks, {"sensor": {"readout": READOUT}})
    report = chip.capture.report
    made, out = len(ideal.capture.events), len(chip.capture.events)
    lost = report.events_dropped
    missing = abs(made - out - lost - report.events_waiting)
    # no more leaves in a millisecond than the link carries
    ends = np.arange(0, ticks * 1000 + 1, 1000)
    busiest = int(np.diff(np.searchsorted(chip.capture.events["t"], ends, "right")).max())
    dropped = report.cameras[0]["events_dropped"]
    messages = (f"{made:,} events generated, {out:,} read out, dropped: {_causes(dropped)}",)
    calm_us = rest * 1000
    after, expected = (capture.within(calm_us, 10**9) for capture in (ideal.capture, chip.capture))
    right = lost > 0 and busiest <= 12_001 and _same_pixels(after, expected)
    return Measurement(missing, 0, "missing events", messages, right)


def _causes(dropped: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {cause}" for cause, count in dropped.items() if count)


def _same_pixels(a: Events, b: Events) -> bool:
    """Whether both have the same counts of each pixel and polarity, and any events."""
    sorted_a, sorted_b = (np.sort(events[["y", "x", "p"]]) for events in (a, b))
    return len(a) > 0 and bool(np.array_equal(sorted_a, sorted_b))


LARGE_PX, LARGE_SHORT_PX = 4096, 1024
"""sides of the largest sensor, and of the one in its place in the short form"""


def _size(width: int, height: int, short: bool) -> Measurement:
    """Move the plate in, out and in again, with thresholds so high that events are few."""
    large = width == height == LARGE_PX
    if large and short:
        width = height = LARGE_SHORT_PX
    edge = 1.2 if large else SHUT
    sensor = {"width": width, "height": height, "pos_thres": 2.0, "neg_thres": 2.0}
    shown = capture_step(lambda tick: OPEN if tick in (0, 2) else edge, 6, {"sensor": sensor})
    on, off = shown.counts()
    # the last pixel has events, and every pixel has the same ones each time
    right = bool(on[-1, -1] > 0 and (off == 2 * on).all())
    report = shown.capture.report
    messages = (
        f"{report.events:,} events from {width}x{height} px, {report.events_dropped} dropped",
    )
    return Measurement(
        shown.residual_thresholds(), 1.0 + shown.rounding(), "thresholds", messages, right
    )


def _network(short: bool) -> Measurement:
    """Run the network of 8 channels in too little memory; all pixels of the sensor change."""
    side = LARGE_SHORT_PX if short else LARGE_PX
    pixels = side * side
    refusal = ""
    try:
        with address_space(600 * pixels):
            _film_network(side, 4)
    except EvsError as error:
        refusal = str(error)
    found = re.search(r"needs ([\d.e+]+) GB, but only [\d.e+-]+ GB are free", refusal)
    needed_gb = state_bytes(pixels) / 1e9
    off_by = abs(float(found[1]) - needed_gb) if found and "\n" not in refusal else float("nan")
    # with room it is there again, and what moves has events
    again = _film_network(64, 4) > 0
    return Measurement(off_by, 0.005 * needed_gb, "GB", (refusal,), again)


def _film_network(side: int, ticks: int) -> int:
    tables = {"sensor": {"width": side, "height": side}, "model": {"name": "evsnet"}}
    return capture_step(lambda tick: SHUT if tick else OPEN, ticks, tables).capture.report.events


def state_bytes(pixels: int) -> int:
    """State of the native runtime for active pixels: 6 float32 an input of a convolution."""
    network = load_network("evsnet_c8")
    if not isinstance(network, NetworkWeights):
        raise EvsError("evsnet_c8 is no network of ours; install evs again")
    inputs = sum(int(one.weight.shape[1]) for one in network.convolutions)
    return pixels * 4 * 6 * inputs


def _plain(width: int, height: int) -> Callable[[bool], Measurement]:
    return partial(_size, width, height)


_TOLD = (
    "every pixel, including the last one, reports the change in light to within one threshold (a "
    "whole threshold would be another event), and again when the change is reversed"
)

CASES = (
    StressCase(
        "threshold-0.001",
        "sensor",
        "thresholds of 0.001: 5,500 events per pixel from white to black",
        f"{_PIXEL} (plus 2^-19 for the rounding of two logarithms); {_REVERSED}",
        _low,
    ),
    StressCase(
        "threshold-10",
        "sensor",
        "thresholds of 10 with a contrast of e^20.7",
        f"{_PIXEL}; {_REVERSED}",
        _high,
    ),
    StressCase(
        "sigma-over-theta",
        "sensor",
        "thresholds of 0.5 with a spread of 0.6",
        f"no threshold is below 0.01; {_PIXEL}; a warning reports the share of thresholds at the "
        "minimum",
        _spread,
    ),
    StressCase(
        "refractory-beyond-run",
        "sensor",
        "pixels that are blind for 100 s after each event",
        "at most one event per pixel, and a warning; pixels with a shorter refractory period see "
        "again afterwards",
        _blind,
    ),
    StressCase(
        "cutoff-0.01-hz",
        "sensor",
        "a step from white to black with a photoreceptor bandwidth of 0.01 Hz",
        "events per pixel: log(255) (1 - e^(-2 pi f t)) / theta, to within 1 plus half the events "
        "of the tick of the step; a warning; after 20 time constants, all events have occurred",
        _slow,
    ),
    StressCase(
        "cutoff-1-mhz",
        "sensor",
        "a bandwidth of 1 MHz, compared with unlimited bandwidth",
        "the same events, late by at most the pole's 1 / (2 pi f) in the dark plus 1 us, because "
        "timestamps are whole microseconds",
        _fast,
    ),
    StressCase(
        "every-pixel-every-tick",
        "sensor",
        "the whole picture alternates between black and white every tick, through the readout of a "
        "DAVIS346",
        "events generated = read out + dropped (counted by cause) + waiting; at most 12 Mev/s are "
        "read out; in a slow sweep afterwards, all events are read out",
        _saturated,
    ),
    StressCase("size-1x1", "sensor", "a sensor with one pixel", _TOLD, _plain(1, 1)),
    StressCase(
        "size-1x4096", "sensor", "a sensor with one column of 4096 pixels", _TOLD, _plain(1, 4096)
    ),
    StressCase(
        "size-4096x4096",
        "sensor",
        "16.8 million pixels (short: 1024 x 1024)",
        _TOLD,
        _plain(LARGE_PX, LARGE_PX),
    ),
    StressCase(
        "evsnet-4096x4096",
        "sensor",
        "the network on 4096 x 4096 pixels (short: 1024 x 1024), all changing, with less memory "
        "than its state needs",
        "rejected with a one-line message that states the required memory (4 x 6 bytes per pixel "
        "and input) to 3 digits; then the network runs on 64 x 64 pixels",
        _network,
    ),
)
