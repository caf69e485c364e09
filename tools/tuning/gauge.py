"""Speed and error of a configuration on the scene that is tuned, measured as `evs sweep` does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from evs.emulator.sensor import resolve_sensor
from evs.msgs import unknown
from evs.tools.evaluation.cache import LightCache
from evs.tools.evaluation.take import MOTIONS
from evs.tools.sweep.errors import ErrorSettings, Judge
from evs.tools.sweep.front import Figure
from evs.tools.sweep.listener import BusListener
from evs.tools.sweep.measured import Error, Setting, Speed
from evs.tools.sweep.points import Point, differences, preset_of
from evs.tools.sweep.speed import SpeedSettings, Timer
from evs.tools.sweep.yardstick import Yardstick
from evs.tools.tuning.base import Base
from evs.tools.tuning.space import Candidate

DEFAULT = "default"
"""the pipeline that points differ from"""

TABLES = ("sensor", "render", "model", "seed")
"""what of a user's pipeline shapes events, but for the scene and the camera, which are filmed"""

START_S = 0.5
"""of a run: loading, opening, the first frame"""
SHOTS = 4.0
"""by how much tracing scattered pixels costs more than tracing whole pictures where little moves"""


@dataclass(frozen=True)
class Effort:
    """How carefully is measured."""

    errors: ErrorSettings
    speeds: SpeedSettings


USUAL = Effort(ErrorSettings(reference_spp=512), SpeedSettings())
QUICK = Effort(
    ErrorSettings(pixels=256, ticks=120, reference_spp=128), SpeedSettings(seconds=0.25, repeats=3)
)


@dataclass
class SceneGauge:
    """Measures candidates. What is measured once is kept by the judge and by the search."""

    base: Base
    judge: Judge
    timer: Timer
    figure: Figure
    own: float = 0.0
    speeds: dict[Candidate, Speed] = field(default_factory=dict)
    errors: dict[Candidate, Error] = field(default_factory=dict)

    def rtf(self, one: Candidate) -> float:
        """Real-time factor, the median of the repeats."""
        self.speeds[one] = self.timer.speed(self.point(one))
        return self.speeds[one].real_time_factor.median

    def error(self, one: Candidate) -> float:
        """Of the figure; NaN where nothing happens."""
        found = self.judge.error(self.point(one))
        self.errors[one] = found
        own = self.figure.own(found)
        self.own = own if math.isfinite(own) else 0.0
        return self.figure.of(found)

    def seconds(self, one: Candidate, rtf: float) -> float:
        """About how long both take."""
        tick_s = 1e-6 * one.tick_us
        run_s = max(2.0 * self.timer.settings.seconds, 8.0 * tick_s / rtf)
        sensor = resolve_sensor(self.base.config.sensor)
        share = self.judge.settings.pixels / (sensor.width * sensor.height)
        light_s = SHOTS * share * 1e-6 * self.judge.settings.end_us / rtf
        return START_S + run_s + light_s

    def point(self, one: Candidate) -> Point:
        """The configuration as a point of a sweep: what differs from the defaults."""
        config = self.base.with_settings(one.settings)
        changed: dict[str, Any] = {}
        for key, value in differences(preset_of(DEFAULT), config).items():
            if key.partition(".")[0] in TABLES and key != "render.flicker":
                changed[key] = value
        changed |= {"scene.tick_us": one.tick_us, "threads": one.threads}
        return Point(DEFAULT, "tune", str(one), _sorted(changed))


def _sorted(changed: Mapping[str, Setting]) -> tuple[tuple[str, Setting], ...]:
    return tuple(sorted(changed.items()))


@contextmanager
def opened(
    base: Base,
    motion: str,
    figure: Figure,
    cache: LightCache,
    effort: Effort = USUAL,
    moved: Callable[[], None] = lambda: None,
) -> Iterator[SceneGauge]:
    """A gauge on the scene of a pipeline, with somebody who listens to the bus.

    In: motion of the camera: still, pan, slide; moved, called now and then. Raises EvsError.
    """
    if motion not in MOTIONS:
        raise unknown("camera motion", motion, MOTIONS)
    stage = base.stage()
    judge = Judge(
        stage, motion, effort.errors, cache, moved=lambda _: moved(), lit=base.config.render
    )
    with BusListener() as listener:
        timer = Timer(stage, motion, effort.speeds, Yardstick(), listener.address)
        yield SceneGauge(base, judge, timer, figure)
