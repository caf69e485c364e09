"""SceneMeasurer: speed and error of a configuration on a scene, measured as in `evs sweep`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from evs.emulator.sensor import resolve_sensor
from evs.msgs import unknown
from evs_lab.evaluation.clip import MOTIONS
from evs_lab.evaluation.light_cache import LightCache
from evs_lab.sweep.bus_listener import BusListener
from evs_lab.sweep.errors import ErrorMeter, ErrorSettings
from evs_lab.sweep.pareto_front import ErrorMetric
from evs_lab.sweep.points import SweepPoint, differences, preset_of
from evs_lab.sweep.record import Accuracy, Setting, Speed
from evs_lab.sweep.speed import SpeedMeter, SpeedSettings, Yardstick
from evs_lab.tuning.base_pipeline import BasePipeline
from evs_lab.tuning.space import Candidate

DEFAULT = "default"
"""the pipeline that points differ from"""

TABLES = ("sensor", "render", "model", "seed")
"""tables of the user's pipeline that shape events, in addition to scene and camera"""

START_S = 0.5
"""of a run: loading, opening, the first frame"""
SHOTS = 4.0
"""cost of tracing scattered pixels, relative to full pictures in which little moves; hybrid traces
full pictures"""


@dataclass(frozen=True)
class MeasurementEffort:
    """How much time measurements take."""

    errors: ErrorSettings
    speeds: SpeedSettings


USUAL = MeasurementEffort(ErrorSettings(reference_spp=512), SpeedSettings())
QUICK = MeasurementEffort(
    ErrorSettings(pixels=256, ticks=120, reference_spp=128), SpeedSettings(seconds=0.25, repeats=3)
)


@dataclass
class SceneMeasurer:
    """Measures candidates; the error meter and the search cache every result."""

    base: BasePipeline
    error_meter: ErrorMeter
    speed_meter: SpeedMeter
    metric: ErrorMetric
    reference_error: float = 0.0
    speeds: dict[Candidate, Speed] = field(default_factory=dict)
    errors: dict[Candidate, Accuracy] = field(default_factory=dict)

    def rtf(self, one: Candidate) -> float:
        """Real-time factor, the median of the repeats."""
        self.speeds[one] = self.speed_meter.speed(self.point(one))
        return self.speeds[one].real_time_factor.median

    def error(self, one: Candidate) -> float:
        """Error by the metric; NaN where nothing happens."""
        found = self.error_meter.error(self.point(one))
        self.errors[one] = found
        reference_error = self.metric.reference_error(found)
        self.reference_error = reference_error if math.isfinite(reference_error) else 0.0
        return self.metric.of(found)

    def seconds(self, one: Candidate, rtf: float) -> float:
        """Estimated time of both measurements."""
        tick_s = 1e-6 * one.tick_us
        run_s = max(2.0 * self.speed_meter.settings.seconds, 8.0 * tick_s / rtf)
        sensor = resolve_sensor(self.base.config.sensor)
        share = SHOTS * self.error_meter.settings.pixels / (sensor.width * sensor.height)
        if one.renderer == "hybrid":
            share = 1.0
        light_s = share * 1e-6 * self.error_meter.settings.end_us / rtf
        return START_S + run_s + light_s

    def point(self, one: Candidate) -> SweepPoint:
        """The configuration as a point of a sweep: what differs from the defaults."""
        config = self.base.with_settings(one.settings)
        changed: dict[str, Any] = {}
        for key, value in differences(preset_of(DEFAULT), config).items():
            if key.partition(".")[0] in TABLES and key != "render.flicker":
                changed[key] = value
        changed |= {"scene.tick_us": one.tick_us, "threads": one.threads}
        return SweepPoint(DEFAULT, "tune", str(one), _sorted(changed))


def _sorted(changed: Mapping[str, Setting]) -> tuple[tuple[str, Setting], ...]:
    return tuple(sorted(changed.items()))


@contextmanager
def open_measurer(
    base: BasePipeline,
    motion: str,
    metric: ErrorMetric,
    cache: LightCache,
    effort: MeasurementEffort = USUAL,
    moved: Callable[[], None] = lambda: None,
) -> Iterator[SceneMeasurer]:
    """A measurer on the scene of a pipeline, with a subscriber on the bus.

    Args:
        base: the pipeline to tune.
        motion: of the camera: still, pan, slide.
        metric: the error metric.
        cache: holds the light.
        effort: how much time measurements take.
        moved: called from time to time.

    Raises:
        EvsError: the scene cannot be loaded, or there is no such motion.
    """
    if motion not in MOTIONS:
        raise unknown("camera motion", motion, MOTIONS)
    setup = base.setup()
    error_meter = ErrorMeter(
        setup, motion, effort.errors, cache, moved=lambda _: moved(), lighting=base.config.render
    )
    with BusListener() as listener:
        speed_meter = SpeedMeter(setup, motion, effort.speeds, Yardstick(), listener.address)
        yield SceneMeasurer(base, error_meter, speed_meter, metric)
