"""Peak rate: the events that leave the chip while light swings faster and faster everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs.emulator.sensor import SensorParameters, make_readout
from evs_lab.characterise import expected
from evs_lab.characterise.bench import F64, Bench
from evs_lab.characterise.quantity import Quantity

LUX = 10_000.0
SWING = 1.0
"""amplitude of log light, to both sides"""

OFFERED = tuple(1e6 * 10.0 ** (k / 3.0) for k in range(-1, 11))
"""rates that the swing is made for, ev/s of all pixels; the measurement stops at the limit"""

SATURATED = 0.4
"""the chip is at its limit if a smaller share of the pixels' events comes out"""

SECONDS = 0.02
TICKS = 100
FILLED = 0.5
"""share of the time after which the queues are full and counting begins"""

MOST_EVENTS = 8_000_000
"""of one measurement; faster ones are shorter"""

LEAST_PATH = 4.0
"""least number of thresholds that the light crosses, since the first events come late"""

BLOCKS = 10
"""of the counted time; their spread gives the error"""


@dataclass(frozen=True)
class PeakRate:
    """Rates into and out of the readout, ascending."""

    offered: F64
    """(n,) rate of the pixels' events, ev/s"""
    passed: F64
    """(n,) rate of the events that came out, ev/s"""
    peak: tuple[float, float]
    """highest rate that came out, standard error; NaN: no limit up to the offered rates"""

    def results(self, sensor: SensorParameters) -> list[Quantity]:
        """The highest rate that comes out."""
        note = ""
        if math.isnan(self.peak[0]):
            note = f"no limit up to {self.passed.max() / 1e6:.0f} Mev/s"
        return [Quantity("peak rate", "ev/s", *self.peak, expected.peak_rate(sensor), LUX, note)]


def measure_peak_rate(bench: Bench) -> PeakRate:
    """Measure faster and faster swings, until the chip or the pixels are at their limit."""
    offered, passed, errors = [], [], []
    for wanted in OFFERED:
        rate_in, out, error = _look(bench, wanted)
        offered.append(rate_in)
        passed.append(out)
        errors.append(error)
        # the chip gives all it can, or the pixels do; slow light may give nothing (high pass)
        full = len(offered) > 1 and 0.0 < rate_in < 1.2 * offered[-2]
        if out < SATURATED * rate_in or full:
            break
    best = int(np.argmax(passed))
    limited = passed[-1] < 0.9 * offered[-1]
    peak = (passed[best], errors[best]) if limited else (math.nan, math.nan)
    return PeakRate(np.array(offered), np.array(passed), peak)


def _look(bench: Bench, wanted: float) -> tuple[float, float, float]:
    """(rate of the pixels, rate that passed, its standard error), ev/s."""
    sensor = bench.sensor
    readout = make_readout(sensor)
    exposure = bench.start(LUX)
    state = readout.init(bench.seed) if readout else None
    # log light goes up and down in straight lines; each pixel gives an event a threshold
    theta = 0.5 * (sensor.pos_thres + sensor.neg_thres)
    speed = wanted * theta / bench.pixels
    seconds = max(min(SECONDS, MOST_EVENTS / wanted), LEAST_PATH * bench.pixels / wanted)
    tick_us = max(1, round(seconds / TICKS * 1e6))
    rate_in = np.zeros(TICKS)
    out = np.zeros(TICKS)
    for k in range(TICKS):
        path = speed * (k + 1) * tick_us * 1e-6
        events = exposure.expose(LUX * math.exp(_triangle(path)), tick_us)
        rate_in[k] = len(events)
        if readout is not None and state is not None:
            events, state = readout.step(events, state, exposure.t_us - tick_us, exposure.t_us)
        out[k] = len(events)
    counted = int(FILLED * TICKS)
    block_s = (TICKS - counted) // BLOCKS * tick_us * 1e-6
    blocks = out[counted:].reshape(BLOCKS, -1).sum(1) / block_s
    return (
        float(rate_in[counted:].mean()) / (tick_us * 1e-6),
        float(blocks.mean()),
        float(blocks.std(ddof=1)) / math.sqrt(BLOCKS),
    )


def _triangle(path: float) -> float:
    """Position after `path` on the way up and down between -SWING and SWING."""
    place = (path + SWING) % (4.0 * SWING)
    return place - SWING if place < 2.0 * SWING else 3.0 * SWING - place
