"""A page with nine charts of a sensor: measured points and expected curves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from evs.drivers.pictures.chart import RGB, Chart, Scale, Series, decades_around, draw_charts
from evs.emulator.sensor.noise_rate import noise_rate_hz, normal_cdf
from evs.msgs.pictures import OFF_RGB, ON_RGB, PAPER, U8
from evs_lab.characterise import Characterisation, Quantity, SCurve, expected
from evs_lab.characterise.background import usual_leak_hz

CHART_PX = (520, 400)
COLUMNS = 3

LEAK_RGB: RGB = (0, 140, 100)
SHOT_RGB: RGB = (150, 80, 190)
ONE_RGB: RGB = (30, 100, 170)
OTHER_RGB: RGB = (225, 130, 0)
PALE = 0.55
"""How far the curve that was set is from its points' colour to paper."""

LAMP = Scale(0.1, 1e5, log=True)
LUX_LABEL = "illuminance of the sensor, lux"
CURVE_POINTS = 97


def characterisation_page(found: Characterisation) -> U8:
    """(height, width, 3): S-curve, maps, latency, bandwidth, noise, blindness, range, peak rate."""
    charts = [
        _s_curve(found),
        _map(found.thresholds.on, "ON"),
        _map(found.thresholds.off, "OFF"),
        _latency(found),
        _bandwidth(found),
        _background(found),
        _dynamic_range(found),
        _refractory(found),
        _peak_rate(found),
    ]
    sensor = found.sensor
    size = f"{sensor.width} x {sensor.height} px"
    part = "" if found.pixels == sensor.width * sensor.height else f", {found.pixels:,} measured"
    words = f"{size}{part}; seed {found.seed}. Points: measured from events alone. Lines: as set."
    heading = f"{sensor.name}: measured, and as it was set"
    return draw_charts(charts, COLUMNS, CHART_PX, heading, words)


def _pale(colour: RGB) -> RGB:
    r, g, b = (round(part + PALE * (PAPER - part)) for part in colour)
    return r, g, b


def _lux_grid() -> list[float]:
    return [float(lux) for lux in np.geomspace(LAMP.low, LAMP.high, CURVE_POINTS)]


def _s_curve(found: Characterisation) -> Chart:
    """OFF to the left, where light falls, ON to the right."""
    sensor, both = found.sensor, found.thresholds
    title = "S-curve: pixels that answer a step, %"
    curves = (
        ("OFF", -1.0, both.off, sensor.neg_thres, OFF_RGB),
        ("ON", 1.0, both.on, sensor.pos_thres, ON_RGB),
    )
    reach = 1.1 * max(
        [c for _, _, curve, _, _ in curves for c in curve.contrast.tolist()], default=0
    )
    if not reach:
        return Chart(title, Scale(-1.0, 1.0), Scale(0.0, 105.0), "", empty="no pixel answers")
    lines, points = [], []
    for name, sign, curve, mean, colour in curves:
        grid = np.linspace(0.0, reach, 257)
        sigma = max(sensor.sigma_thres, 1e-9)
        share = [100.0 * normal_cdf((c - mean) / sigma) for c in grid]
        lines.append(Series((sign * grid).tolist(), share, _pale(colour), line=True))
        fit = curve.fit
        label = f"{name} {fit.mean:.4f}, sigma {fit.sigma:.4f}"
        x, y = (sign * curve.contrast).tolist(), (100.0 * curve.share).tolist()
        points.append(Series(x, y, colour, label))
    return Chart(title, Scale(-reach, reach), Scale(0.0, 105.0),
                 "step of contrast, ln of the ratio of light", [*lines, *points])  # fmt: skip


def _map(curve: SCurve, name: str) -> Chart:
    """Thresholds over the array, blue low, red high."""
    theta = curve.thresholds
    title = f"{name} threshold of each pixel"
    if not np.isfinite(theta).any():
        return Chart(title, Scale(0.0, 1.0), Scale(0.0, 1.0), "", empty="no pixel answers")
    mean, spread = float(np.nanmean(theta)), float(np.nanstd(theta))
    reach = max(3.0 * spread, 1e-3 * mean)
    scale = Scale(mean - reach, mean + reach)
    return Chart(title, scale, scale, "grey: did not answer", picture=theta)


def _of(results: Sequence[Quantity], quantity: str) -> list[Quantity]:
    return [r for r in results if r.quantity == quantity and math.isfinite(r.measured)]


def _points(results: Sequence[Quantity], colour: RGB, label: str) -> Series:
    return Series(
        [r.lux or 0.0 for r in results],
        [r.measured for r in results],
        colour,
        label,
        error=[r.error for r in results],
    )


def _y_scale(values: Sequence[float], unit: str) -> Scale:
    return Scale(*decades_around(list(values)), log=True, unit=unit)


def _latency(found: Characterisation) -> Chart:
    results = found.latency_results()
    grid = _lux_grid()
    pairs = [expected.latency_s(found.sensor, lux) for lux in grid]
    series = []
    for k, (name, colour) in enumerate((("latency", ONE_RGB), ("jitter", OTHER_RGB))):
        series.append(Series(grid, [pair[k] for pair in pairs], _pale(colour), line=True))
        series.append(_points(_of(results, name), colour, name))
    series.sort(key=lambda one: not one.line)
    seen = [y for one in series if not one.line for y in one.y]
    y = _y_scale([max(value, 1e-7) for value in seen], "s")
    at_once = seen and max(seen) <= 1e-6
    return Chart("Latency and jitter, light doubles", LAMP, y, LUX_LABEL, series,
                 empty="" if seen and not at_once else "all within a microsecond")  # fmt: skip


def _bandwidth(found: Characterisation) -> Chart:
    grid = _lux_grid()
    line = [expected.half_power_hz(found.sensor, lux) for lux in grid]
    points = _points(_of(found.bandwidth_results(), "bandwidth, -3 dB"), ONE_RGB, "-3 dB")
    y = _y_scale([*points.y, *(v for v in line if math.isfinite(v))], "Hz")
    empty = "" if points.y else "faster than the bench"
    series = [Series(grid, line, _pale(ONE_RGB), line=True), points]
    return Chart("Bandwidth", LAMP, y, LUX_LABEL, series, empty=empty)


def _background(found: Characterisation) -> Chart:
    results = found.background_results()
    sensor, grid = found.sensor, _lux_grid()
    lines = [
        Series(grid, [usual_leak_hz(sensor, found.background, lux) for lux in grid],
               _pale(LEAK_RGB), line=True),
        Series(grid, [noise_rate_hz(sensor, lux) for lux in grid], _pale(SHOT_RGB),
               line=True),
    ]  # fmt: skip
    seen = [at for at in found.background if at.on[0] + at.off[0] > 0.0]
    rates = [
        Series([at.lux for at in seen], [getattr(at, name)[0] for at in seen], colour,
               f"all {name.upper()}", ring_px=ring)
        for name, colour, ring in (("on", ON_RGB, 6.5), ("off", OFF_RGB, 9.5))
    ]  # fmt: skip
    points = [
        _points(_of(results, "shot noise rate"), SHOT_RGB, "shot noise"),
        _points(_of(results, "leak rate"), LEAK_RGB, "leak"),
    ]
    every = [y for one in (*lines, *rates, *points) for y in one.y]
    y = _y_scale([rate for rate in every if rate > 1e-5 * max(every)], "Hz")
    return Chart("Background rate of a pixel", LAMP, y, LUX_LABEL, [*lines, *points, *rates],
                 empty="" if seen else "no event in 1000 s")  # fmt: skip


def _dynamic_range(found: Characterisation) -> Chart:
    result, sensor = found.dynamic_range, found.sensor
    x = Scale(float(result.lux[0]), float(result.lux[-1]), log=True)
    grid = np.geomspace(x.low, x.high, 193).tolist()
    line = [100.0 * expected.answering_share(sensor, lux) for lux in grid]
    label = f"{result.decibels:.1f} dB" if math.isfinite(result.decibels) else ""
    points = Series(result.lux.tolist(), (100.0 * result.share).tolist(), ONE_RGB, label)
    return Chart("Dynamic range: pixels that answer + 80 %, %", x, Scale(0.0, 105.0), LUX_LABEL,
                 [Series(grid, line, _pale(ONE_RGB), line=True), points],
                 marks=[(50.0, "one half")])  # fmt: skip


def _refractory(found: Characterisation) -> Chart:
    result = found.refractory
    period_s = found.sensor.refractory_period_s
    high = max(3.0 * period_s, 1e-5)
    scale = Scale(0.0, high, unit="s")
    # no interval is shorter than the period; a later step is answered when it comes
    grid = np.linspace(0.0, high, 601)
    line = Series(grid.tolist(), np.maximum(grid, period_s).tolist(), _pale(ONE_RGB), line=True)
    pairs = [
        (1e-6 * delay, 1e-6 * interval)
        for delay, interval in zip(result.delays_us, result.intervals_us, strict=True)
        if interval >= 0
    ]
    # stamps are whole us: the first event comes in the one after
    blind = f"blind for {result.period_us:g} us, never under {result.shortest_us} us"
    label = blind if result.shortest_us >= 0 else ""
    points = Series([x for x, _ in pairs], [y for _, y in pairs], ONE_RGB, label)
    return Chart("Refractory period: shortest interval of two events", scale, scale,
                 "from one step of light to the next", [line, points])  # fmt: skip


def _peak_rate(found: Characterisation) -> Chart:
    result = found.peak_rate
    x = _y_scale(result.offered.tolist(), "")
    y = _y_scale([*result.passed.tolist(), *result.offered.tolist()], "")
    grid = np.geomspace(x.low, x.high, CURVE_POINTS).tolist()
    limit = expected.peak_rate(found.sensor)
    most = math.inf if math.isnan(limit) else limit
    line = Series(grid, [min(value, most) for value in grid], _pale(ONE_RGB), line=True)
    peak = result.peak[0]
    label = f"{peak / 1e6:.3g} Mev/s at most" if math.isfinite(peak) else "no limit seen"
    points = Series(result.offered.tolist(), result.passed.tolist(), ONE_RGB, label)
    return Chart("Peak rate: events a second that come out", x, y,
                 "events a second that the pixels give", [line, points])  # fmt: skip
