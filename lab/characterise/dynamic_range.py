"""Dynamic range: from the least light in which half of the pixels respond to the most."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs_lab.characterise.bench import F64, Bench, share_of
from evs_lab.characterise.expected import CONTRAST, lowest_lux
from evs_lab.characterise.quantity import Quantity
from evs_lab.characterise.settle import settle

DARKEST_LUX, BRIGHTEST_LUX = 1e-3, 1e5
"""range of the lamp; full sun is 100 klux"""

PIXELS = 10_000
A_DECADE = 2
"""points of the curve; then the crossing of one half is found by bisection"""

HALVINGS = 5


@dataclass(frozen=True)
class DynamicRange:
    """Share of the pixels that respond, by illuminance."""

    lux: F64
    """(n,) ascending, before the step"""
    share: F64
    """(n,)"""
    lowest_lux: tuple[float, float]
    """illuminance at which half of them respond, standard error; NaN: nowhere"""
    highest_lux: float

    @property
    def decibels(self) -> float:
        """20 log10 of their ratio."""
        return 20.0 * math.log10(self.highest_lux / self.lowest_lux[0])

    def results(self, sensor: SensorParameters) -> list[Quantity]:
        """Least illuminance at which half of the pixels respond, and the range to the highest."""
        promised = math.nan
        if not sensor.highpass_hz:
            promised = lowest_lux(sensor, DARKEST_LUX, BRIGHTEST_LUX)
        lowest, error = self.lowest_lux
        note = "the lamp ends here" if self.highest_lux == BRIGHTEST_LUX else ""
        nowhere = "the high pass takes part of the step" if sensor.highpass_hz else ""
        nowhere = "half of the pixels answer nowhere" if math.isnan(lowest) else nowhere
        range_error = 20.0 / math.log(10.0) * error / lowest
        promised_range = 20.0 * math.log10(BRIGHTEST_LUX / promised)
        return [
            Quantity("least illuminance", "lux", lowest, error, promised, None, nowhere),
            Quantity(
                "dynamic range",
                "dB",
                self.decibels,
                range_error,
                promised_range,
                None,
                note or nowhere,
            ),
        ]


def measure_dynamic_range(bench: Bench) -> DynamicRange:
    """Measure the share of the pixels that respond over the range of the lamp."""
    # events of photon noise would count as responses
    part = bench.part(PIXELS, photocurrent_pa=0.0)
    shares_at: dict[float, tuple[float, int]] = {}

    def ask(exponent: float) -> float:
        if exponent not in shares_at:
            settled = settle(part, 10.0**exponent)
            quiet = settled.quiet()
            yes = settled.step(CONTRAST * settled.lux, True)
            shares_at[exponent] = (share_of(yes, quiet), int(np.count_nonzero(quiet)))
        return shares_at[exponent][0]

    low, high = math.log10(DARKEST_LUX), math.log10(BRIGHTEST_LUX)
    ladder = np.linspace(low, high, round((high - low) * A_DECADE) + 1).tolist()
    enough = [ask(exponent) >= 0.5 for exponent in ladder]
    lowest, highest = (math.nan, math.nan), math.nan
    if any(enough):
        first = enough.index(True)
        highest = 10.0 ** ladder[len(enough) - 1 - enough[::-1].index(True)]
        lowest = (10.0 ** ladder[0], 0.0)
        if first > 0:
            dark, light = _halve(ask, ladder[first - 1], ladder[first])
            lowest = _between(dark, ask(dark), light, ask(light), shares_at[light][1])
    exponents = sorted(shares_at)
    shares = np.array([shares_at[exponent][0] for exponent in exponents])
    return DynamicRange(10.0 ** np.array(exponents), shares, lowest, highest)


def _halve(ask: Callable[[float], float], dark: float, light: float) -> tuple[float, float]:
    """Bisect: two close exponents between which the share crosses one half."""
    for _ in range(HALVINGS):
        middle = 0.5 * (dark + light)
        dark, light = (dark, middle) if ask(middle) >= 0.5 else (middle, light)
    return dark, light


def _between(
    dark: float, below: float, light: float, above: float, pixels: int
) -> tuple[float, float]:
    """(illuminance, standard error) at which a straight line reaches one half."""
    slope = max((above - below) / (light - dark), 1e-9)
    lux = 10.0 ** (dark + (0.5 - below) / slope)
    # of a share, or of the step where all pixels turn at once
    error = min(0.5 / math.sqrt(max(pixels, 1)) / slope, light - dark)
    return lux, lux * math.log(10.0) * error
