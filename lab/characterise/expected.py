"""The curves that follow from the parameters of a sensor, to compare with measured points.

Only this module knows the laws; the measurements do not. An illuminance is that of the lamp; dark
current adds to it in the pixel.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.noise_rate import leak_rate_hz, normal_cdf
from evs.emulator.sensor.pixel import log_light

DOUBLED = 2.0
"""light after the step over light before it, for latency"""

CONTRAST = 1.8
"""the same for the dynamic range: 80 %, as manufacturers state it"""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(48)

HALF = 0.5
"""share of the pixels that must respond for a latency to be defined"""


def pole_hz(sensor: SensorParameters, lux: float) -> float:
    """Bandwidth of the pixel at an illuminance; inf: it is not limited."""
    if sensor.cutoff_hz == 0.0:
        return math.inf
    lux += sensor.dark_current_lux
    ratio = (lux + sensor.dim_lux) / (sensor.bright_lux + sensor.dim_lux)
    return sensor.cutoff_hz * ratio


def half_power_hz(sensor: SensorParameters, lux: float) -> float:
    """Frequency at -3 dB of both poles in series; inf: there is none.

    With q = f^2 the poles a, b give (1 + q / a^2)(1 + q / b^2) = 2, a quadratic equation.
    """
    a, b = pole_hz(sensor, lux), sensor.follower_hz or math.inf
    if math.isinf(a) or math.isinf(b):
        return min(a, b)
    sum_of_squares = a * a + b * b
    root = math.sqrt(sum_of_squares**2 + 4.0 * (a * b) ** 2)
    # (root - sum) / 2 without cancellation
    return math.sqrt(2.0 * (a * b) ** 2 / (root + sum_of_squares))


def time_constants_s(sensor: SensorParameters, lux: float) -> tuple[float, float]:
    """Time constants of the two poles, s; 0: there is no such pole."""
    poles = (pole_hz(sensor, lux), sensor.follower_hz or math.inf)
    first, second = (0.0 if math.isinf(pole) else 1.0 / (2.0 * math.pi * pole) for pole in poles)
    return first, second


def step_time_s(sensor: SensorParameters, lux: float, share: float, step: float = 0.0) -> float:
    """Time after a step of light until a share of it has come through; inf: never.

    Args:
        sensor: the sensor.
        lux: illuminance after the step.
        share: share of the step, in log light.
        step: its height, log units; the large-signal photoreceptor depends on it.
    """
    if not share < 1.0:
        return math.inf
    one, two = time_constants_s(sensor, lux)
    if sensor.filter == "large_signal" and step and one and share > 0.0:
        return _large_step_time_s(one, two, share, step)
    if one == 0.0 or two == 0.0 or share <= 0.0:
        return -(one + two) * math.log1p(-max(share, 0.0))
    if math.isclose(one, two, rel_tol=1e-6):
        two *= 1.0 + 2e-6

    def through(t: float) -> float:
        return 1.0 - (one * math.exp(-t / one) - two * math.exp(-t / two)) / (one - two)

    low, high = 0.0, 40.0 * (one + two)
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if through(middle) < share else (low, middle)
    return high


def _large_step_time_s(one: float, two: float, share: float, step: float) -> float:
    """step_time_s of the large-signal photoreceptor and the follower behind it."""

    def first(t: F64 | float) -> F64:
        """Share of the step behind the photoreceptor: q = 1 + (e^step - 1) e^-wt."""
        left = np.log1p(math.expm1(step) * np.exp(-np.asarray(t) / one))
        return np.asarray(1.0 - left / step)

    def through(t: float) -> float:
        if two == 0.0:
            return float(first(t))
        # the follower forgets: Gauss-Legendre between the places where either is steep
        ends = sorted({0.0, min(t, 20.0 * one), max(0.0, t - 20.0 * two), t})
        total = 0.0
        for low, high in pairwise(ends):
            at = 0.5 * (low + high) + 0.5 * (high - low) * NODES
            kept = np.exp((at - t) / two) / two
            total += float(0.5 * (high - low) * (WEIGHTS * first(at) * kept).sum())
        return total

    low, high = 0.0, (40.0 + abs(step)) * (one + two)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if through(middle) < share else (low, middle)
    return high


def log_step(sensor: SensorParameters, lux: float, after: float) -> float:
    """Change of log light when the illuminance changes from `lux` to `after`."""
    lights = np.array([lux, after]) / (sensor.lux_per_dn * sensor.exposure_dn)
    first, second = log_light(lights.astype(np.float32), sensor).astype(np.float64)
    return float(second - first)


def ramp_contrast(
    sensor: SensorParameters, on: bool, lux: float, slope: float
) -> tuple[float, float]:
    """Weber contrast between two events on a ramp: that of the mean threshold, and its spread.

    Args:
        sensor: its parameters.
        on: the polarity.
        lux: illuminance in the middle of the ramp.
        slope: of the ramp, log units a second; the leak helps ON events and hinders OFF events.

    Returns:
        (contrast, its standard deviation over pixels), of 1; NaN: the leak or the high pass is
        faster than the ramp.
    """
    theta = sensor.pos_thres if on else sensor.neg_thres
    leak = leak_rate_hz(sensor, lux) * sensor.pos_thres
    drive = slope + leak if on else slope - leak
    # at the threshold, where the reference follows the light fastest
    follows = 2.0 * math.pi * sensor.highpass_hz
    left = drive - follows * theta
    if left < 0.1 * slope:
        return math.nan, math.nan
    interval_s = -math.log1p(-follows * theta / drive) / follows if follows else theta / drive
    variance = (slope * sensor.sigma_thres / left) ** 2
    # of a log-normal ratio of light
    spread = math.exp(slope * interval_s + 0.5 * variance) * math.sqrt(math.expm1(variance))
    return math.expm1(slope * interval_s), spread


def lowest_lux(sensor: SensorParameters, darkest: float, brightest: float) -> float:
    """Least illuminance at which a step by CONTRAST crosses the mean ON threshold.

    NaN: not even at `brightest`. Log light of a ratio grows with the illuminance.
    """
    if log_step(sensor, brightest, brightest * CONTRAST) < sensor.pos_thres:
        return math.nan
    low, high = math.log(darkest), math.log(brightest)
    for _ in range(60):
        middle = 0.5 * (low + high)
        lux = math.exp(middle)
        enough = log_step(sensor, lux, lux * CONTRAST) >= sensor.pos_thres
        low, high = (low, middle) if enough else (middle, high)
    return math.exp(high)


def latency_s(sensor: SensorParameters, lux: float) -> tuple[float, float]:
    """(mean, standard deviation) over the pixels whose thresholds doubled light can cross, s.

    NaN if they are fewer than half. Latencies are not cut at 0.
    """
    step = log_step(sensor, lux / DOUBLED, lux)
    if step <= 0.0:
        return math.nan, math.nan
    # at evenly spaced probabilities of a normal distribution
    z = np.linspace(-4.0, 4.0, 161)
    weight = np.exp(-0.5 * z * z)
    times = np.array(
        [
            step_time_s(sensor, lux, (sensor.pos_thres + sensor.sigma_thres * k) / step, step)
            for k in z
        ]
    )
    there = np.isfinite(times)
    if weight[there].sum() < HALF * weight.sum():
        return math.nan, math.nan
    weight, times = weight[there] / weight[there].sum(), times[there]
    mean = float(weight @ times)
    variance = max(float(weight @ (times - mean) ** 2), 0.0)
    late_s, sigma_s = 1e-6 * sensor.latency_us, 1e-6 * sensor.latency_sigma_us
    return mean + late_s, math.sqrt(variance + sigma_s**2)


def answering_share(sensor: SensorParameters, lux: float) -> float:
    """Share of the pixels that respond to a step by CONTRAST."""
    step = log_step(sensor, lux, CONTRAST * lux)
    return normal_cdf((step - sensor.pos_thres) / max(sensor.sigma_thres, 1e-12))


def peak_rate(sensor: SensorParameters) -> float:
    """Rate of the bottleneck of the readout, ev/s; NaN: there is none."""
    readout = sensor.readout
    limits = [1e6 * mevs for mevs in (readout.bandwidth_mevs, readout.erc_rate_mevs) if mevs > 0.0]
    if readout.order == "arbiter":
        # rows that are full
        row_ns = readout.row_ns + sensor.width * readout.column_ns
        limits += [sensor.width / row_ns * 1e9] if row_ns else []
    if readout.order == "scan":
        # scans of the whole array, each of which may skip others
        pixels, events = sensor.width * sensor.height, readout.scan_events
        scans = math.ceil(pixels / events) if events else 1
        scans = math.ceil(scans / readout.scan_every) * readout.scan_every
        limits.append(pixels / (scans * readout.scan_us) * 1e6)
    return min(limits, default=math.nan)
