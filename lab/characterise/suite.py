"""All measurements of a sensor, one after the other."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from evs_lab.characterise.background import (
    LADDER_LUX,
    Background,
    background_results,
    measure_background,
)
from evs_lab.characterise.bandwidth import LADDER_LUX as BANDWIDTH_LUX
from evs_lab.characterise.bandwidth import Bandwidth, bandwidth_results, measure_bandwidth
from evs_lab.characterise.bench import Bench
from evs_lab.characterise.contrast import Thresholds, measure_thresholds
from evs_lab.characterise.dynamic_range import DynamicRange, measure_dynamic_range
from evs_lab.characterise.latency import LADDER_LUX as LATENCY_LUX
from evs_lab.characterise.latency import Latency, latency_results, measure_latency
from evs_lab.characterise.peak_rate import PeakRate, measure_peak_rate
from evs_lab.characterise.quantity import Quantity
from evs_lab.characterise.ramp import RampThresholds, measure_ramp
from evs_lab.characterise.refractory import Refractory, measure_refractory

PIXELS = 100_000
"""At most so many are measured: the upper left corner of a larger sensor."""

LEAST_PIXELS = 64

STEPS = 5 + len(LADDER_LUX) + len(BANDWIDTH_LUX) + len(LATENCY_LUX)
"""How often `moved` is called."""


@dataclass(frozen=True)
class Characterisation:
    """What the bench found out about a sensor."""

    sensor: SensorParameters
    pixels: int
    """how many were measured"""
    seed: int
    thresholds: Thresholds
    ramp: RampThresholds
    background: list[Background]
    refractory: Refractory
    bandwidth: list[Bandwidth]
    latency: list[Latency]
    dynamic_range: DynamicRange
    peak_rate: PeakRate

    def results(self) -> list[Quantity]:
        """Every number beside what was set."""
        sensor = self.sensor
        return [
            *self.thresholds.results(sensor),
            *self.thresholds.weber_results(sensor),
            *self.ramp.results(sensor),
            *self.dynamic_range.results(sensor),
            *self.latency_results(),
            *self.bandwidth_results(),
            *self.background_results(),
            *self.refractory.results(sensor),
            *self.peak_rate.results(sensor),
        ]

    def latency_results(self) -> list[Quantity]:
        """Latency and jitter of every illuminance."""
        return latency_results(self.sensor, self.latency)

    def bandwidth_results(self) -> list[Quantity]:
        """Bandwidth of every illuminance."""
        return bandwidth_results(self.sensor, self.bandwidth)

    def background_results(self) -> list[Quantity]:
        """Noise and leak of every illuminance, hot pixels."""
        return background_results(self.sensor, self.background)

    def plain(self) -> dict[str, Any]:
        """Plain values for JSON: sensor, results, curves. What is NaN or infinite is None."""
        results = [
            {**dataclasses.asdict(result), "deviation": result.deviation}
            for result in self.results()
        ]
        curves: dict[str, Any] = {name: _as_dict(getattr(self, name)) for name in _CURVES}
        # the maps are in the picture; their numbers would be most of the file
        for polarity in ("on", "off"):
            del curves["thresholds"][polarity]["thresholds"]
            del curves["ramp"][polarity]["contrast"]
        return {
            "sensor": _plain(dataclasses.asdict(self.sensor)),
            "pixels": self.pixels,
            "seed": self.seed,
            "results": _plain(results),
            "curves": _plain(curves),
        }


_CURVES = (
    *("thresholds", "ramp", "dynamic_range", "latency", "bandwidth"),
    *("background", "refractory", "peak_rate"),
)


def characterise(
    sensor: SensorParameters,
    seed: int = 0,
    threads: int = 0,
    pixels: int = PIXELS,
    moved: Callable[[str], None] = lambda _: None,
) -> Characterisation:
    """Measure a sensor as its makers would, from its events alone.

    Args:
        sensor: its parameters.
        seed: of all random numbers.
        threads: worker threads; 0: one per core.
        pixels: at most so many are measured, but for the peak rate, which is that of the whole
            sensor.
        moved: called with a description of what comes next, STEPS times.

    Raises:
        EvsError: too few pixels.
    """
    if pixels < LEAST_PIXELS:
        raise EvsError(f"{pixels} pixels are too few to measure; give {LEAST_PIXELS} or more")
    full_bench = Bench(sensor, seed, threads)
    bench = full_bench.part(pixels)
    moved("thresholds")
    thresholds = measure_thresholds(bench)
    moved("ramp thresholds")
    ramp = measure_ramp(bench)
    moved("refractory period")
    refractory = measure_refractory(bench)
    moved("dynamic range")
    dynamic_range = measure_dynamic_range(bench)
    latency = []
    for lux in LATENCY_LUX:
        moved(f"latency at {lux:g} lux")
        latency.append(measure_latency(bench, lux))
    bandwidth = []
    for lux in BANDWIDTH_LUX:
        moved(f"bandwidth at {lux:g} lux")
        bandwidth.append(measure_bandwidth(bench, lux))
    background = measure_background(
        bench,
        LADDER_LUX,
        thresholds.unevenness,
        lambda lux: moved(f"background at {lux:g} lux"),
    )
    moved("peak rate")
    peak_rate = measure_peak_rate(full_bench)
    return Characterisation(
        sensor, bench.pixels, seed, thresholds, ramp, background, refractory, bandwidth, latency,
        dynamic_range, peak_rate,
    )  # fmt: skip


def _as_dict(value: Any) -> Any:
    """Of a dataclass, or of each in a list."""
    if isinstance(value, list):
        return [dataclasses.asdict(item) for item in value]
    return dataclasses.asdict(value)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value
