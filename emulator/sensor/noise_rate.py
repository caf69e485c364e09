"""The rates of noise and leak events that follow from the parameters of a sensor.

Photon noise by the model of core/sensor/photon_noise.h: after an event the noise is known, and it
returns to its mean while a hazard runs. Of a pixel in still light this is a chain of references
that are one threshold apart.
"""

from __future__ import annotations

import math

import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.parameters import MOST_HOT_LEAK_HZ
from evs.emulator.sensor.reference.passage import Band, passage_loss, passage_rate

PHASES = 8
"""distances of the references from the light that count, in parts of a threshold: leak brings
every one of them in turn"""

TIMES = np.concatenate([[0.0], np.geomspace(1e-4, 12.0, 160)])
"""after an event, in memories of the noise"""

FARTHEST = 7.0
"""deviations from the mean at which there are references"""

MOST_STATES = 400
LEAST_HZ = 1e-6
"""an event of a pixel in eleven days; lower rates are 0"""

LONGEST = 1e30
"""a wait without end"""

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)


def normal_cdf(z: float) -> float:
    """Probability below z."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def leak_rate_hz(sensor: SensorParameters, lux: float, hot_hz: float = math.inf) -> float:
    """Rate of the ON events of leak, mean over the pixels, without noise that restarts it.

    Args:
        sensor: the sensor.
        lux: illuminance.
        hot_hz: pixels whose part of the hot tail is over this are left out.
    """
    share = (lux + sensor.dark_current_lux) / sensor.bright_lux
    usual = sensor.leak_rate_hz * sensor.thermal_factor + sensor.parasitic_leak_hz * share
    over, _, below = hot_tail(sensor, hot_hz)
    return usual + (below if over < 1.0 else 0.0)


def hot_tail(sensor: SensorParameters, limit_hz: float) -> tuple[float, float, float]:
    """(share of pixels whose tail of leak is over a limit, its mean over those, over the others).

    The tail is log-normal and ends at MOST_HOT_LEAK_HZ. A mean of no pixels is 0.
    """
    if not sensor.has_hot_pixels:
        return 0.0, 0.0, 0.0
    median = sensor.hot_leak_median_hz * sensor.thermal_factor
    sigma = sensor.hot_leak_cov_decades * math.log(10.0)
    if sigma == 0.0:
        rate = min(median, MOST_HOT_LEAK_HZ)
        return (1.0, rate, 0.0) if rate > limit_hz else (0.0, 0.0, rate)

    def below(hz: float) -> tuple[float, float]:
        """Share of the pixels below a rate, and their sum of rates."""
        z = (math.log(hz) - math.log(median)) / sigma if hz > 0.0 else -math.inf
        mean = median * math.exp(0.5 * sigma**2)
        return normal_cdf(z), mean * normal_cdf(z - sigma)

    most_share, most_sum = below(MOST_HOT_LEAK_HZ)
    total = most_sum + (1.0 - most_share) * MOST_HOT_LEAK_HZ
    if limit_hz >= MOST_HOT_LEAK_HZ:
        return 0.0, 0.0, total
    share, lower = below(limit_hz)
    above = 1.0 - share
    return above, (total - lower) / above if above else 0.0, lower / share if share else 0.0


def shot_rate_hz(sensor: SensorParameters, lux: float) -> float:
    """Rate of the Poisson noise events of both polarities, mean over the pixels."""
    lux += sensor.dark_current_lux
    bright, dim = sensor.shot_noise_bright, sensor.dim_lux
    if sensor.shot_noise_law == "inverse":
        share = bright + (1.0 - bright) * dim / (dim + lux)
    else:
        share = 1.0 - (1.0 - bright) * min(1.0, (lux + dim) / (sensor.bright_lux + dim))
    return sensor.shot_noise_rate_hz * share


def photon_rate_hz(sensor: SensorParameters, lux: float) -> float:
    """Rate of the events of photon noise of both polarities, mean over the pixels.

    Each pixel has the mean of its two thresholds; the refractory period does not count.
    """
    if sensor.photocurrent_pa == 0.0:
        return 0.0
    dn = (lux + sensor.dark_current_lux) / sensor.lux_per_dn
    band = Band.at(sensor, dn)
    mean = 0.5 * (sensor.pos_thres + sensor.neg_thres)
    # of the mean of two independent thresholds
    thresholds = np.maximum(mean + sensor.sigma_thres * math.sqrt(0.5) * _NODES, min(0.01, mean))
    leak = 1e-6 * leak_rate_hz(sensor, lux, 1.0) / band.decay
    # half the mean difference of two normal thresholds
    uneven = sensor.sigma_thres / math.sqrt(math.pi) / mean
    if sensor.highpass_hz > 0.0:
        leak = uneven = 0.0  # the references stay with the light
    rates = [_rate(band, theta / band.sigma, leak, uneven) for theta in thresholds]
    rate_hz = 1e6 * band.decay * float(np.average(rates, weights=_WEIGHTS))
    return rate_hz if rate_hz > LEAST_HZ else 0.0


def noise_rate_hz(sensor: SensorParameters, lux: float) -> float:
    """Rate of all noise events of both polarities, mean over the pixels."""
    return shot_rate_hz(sensor, lux) + photon_rate_hz(sensor, lux)


def _rate(band: Band, theta: float, leak: float, uneven: float) -> float:
    """Events of a pixel in a memory of the noise.

    Args:
        band: The noise.
        theta: Threshold, deviations.
        leak: Thresholds that the reference sinks in a memory.
        uneven: Half the difference of the two thresholds, of 1.
    """
    if theta > 2.0 * FARTHEST:
        return 0.0
    most = min(math.ceil(FARTHEST / theta), MOST_STATES // 2)
    phases = np.arange(PHASES)[:, None] / PHASES
    references = (np.arange(-most, most + 1) + phases) * theta
    waits, up = (each.reshape(references.shape) for each in _waits(band, theta, references.ravel()))
    # a chain of references: its share of events, from the balance of each step
    ratio = np.maximum(up[:, :-1], 1e-300) / np.maximum(1.0 - up[:, 1:], 1e-300)
    logs = np.concatenate([np.zeros((PHASES, 1)), np.cumsum(np.log(ratio), axis=1)], axis=1)
    share = np.exp(logs - logs.max(axis=1, keepdims=True))
    rates: F64 = share.sum(axis=1) / (share * waits).sum(axis=1)
    # a phase lasts as long as leak and events, whose thresholds differ, need to move it on
    speed = leak + rates * uneven
    return float((rates / speed).sum() / (1.0 / speed).sum()) if speed.all() else float(rates[0])


def _waits(band: Band, theta: float, reference: F64) -> tuple[F64, F64]:
    """(mean time until the next event, in memories; share of ON events), after each reference.

    Args:
        band: The noise.
        theta: Threshold, deviations.
        reference: (n,) where the last event left it, from the light; the noise was there.
    """
    memory = np.exp(-TIMES)[1:]
    unknown = np.sqrt(1.0 - memory**2)
    moved = reference[:, None] * (1.0 - memory)
    shift = np.full((1, 1), band.shift, np.float32)
    hazards, losses = [], []
    for sign in (1.0, -1.0):
        x = np.clip((theta + sign * moved) / unknown, -8.0, 8.0).astype(np.float32)
        hazards.append(passage_rate(shift, x) * (band.slow / band.decay) / unknown**2)
        # what a level that comes nearer passes of the distribution
        loss = np.concatenate([np.zeros((len(reference), 1)), passage_loss(x)], axis=1)
        losses.append(np.maximum(np.diff(loss, axis=1), 0.0))
    width = np.diff(TIMES)
    on, off = (h * width + loss for h, loss in zip(hazards, losses, strict=True))
    total = np.cumsum(on + off, axis=1)
    before = np.exp(-np.concatenate([np.zeros((len(reference), 1)), total[:, :-1]], axis=1))
    fired = before * -np.expm1(-(on + off))
    share = on / np.maximum(on + off, 1e-300)
    # a part of each step, by its own hazard
    waits = (fired / np.maximum((on + off) / width, 1e-300)).sum(axis=1)
    up = (fired * share).sum(axis=1)
    # then its memory is lost
    left = np.exp(-total[:, -1])
    last_on, last_off = (h[:, -1].astype(np.float64) for h in hazards)
    last = np.maximum(last_on + last_off, 1.0 / LONGEST)
    return waits + left / last, up + left * np.where(last > 2.0 / LONGEST, last_on / last, 0.5)
