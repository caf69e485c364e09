"""Errors: compare the events of a point with those of converged light.

The definitions are those of `evs evaluate`: sampled pixels, events of converged light in two halves
as the reference, a sensor without noise. Nothing here is timed, so any machine will do.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from evs.drivers.run.config import PipelineConfig
from evs.emulator.base.scene import F32
from evs.emulator.base.small_files import read_small_text
from evs.emulator.config import ModelConfig, RenderConfig, SensorConfig
from evs.emulator.sensor import resolve_sensor
from evs.emulator.world import digest_of
from evs.msgs import Events, EvsError
from evs.tools.jobs import job_threads, report_progress
from evs_lab.evaluation.clip import TICK_US, Clip, make_clip
from evs_lab.evaluation.clip_light import HALF_SEEDS, WARM
from evs_lab.evaluation.digest import digest
from evs_lab.evaluation.evaluate import stands_still
from evs_lab.evaluation.light_cache import LightCache
from evs_lab.evaluation.measure import Mask, Measures, measure
from evs_lab.evaluation.scenes import SceneSetup, scene_setup
from evs_lab.sweep.clip_renderer import ClipRenderer, Moved
from evs_lab.sweep.frame_methods import frame_method
from evs_lab.sweep.pixels import (
    check_tick,
    events_of,
    metered_sensor,
    network_events,
    network_model,
)
from evs_lab.sweep.points import SweepPoint, preset_of, shaping
from evs_lab.sweep.record import FRAMES, Accuracy, finite, number

FINE_US = 250
"""step of the physics of every error, and the shortest tick"""
SETTLE_TICKS = 24
"""ms at the beginning that are not measured, while running means and windows settle"""
MAX_DELAY_US = 24_000
"""of a cycle of seeds"""
AHEAD_TICKS = 48
"""ms of light after the last one measured: networks look ahead, cycles are late, a frame may end
late"""
PATCH_PX = 4
"""the least: an error has no value of the patch"""
MAX_SPP = 4096


@dataclass(frozen=True)
class ErrorSettings:
    """Settings of the measurement of errors.

    Raises:
        EvsError: a value is out of range.
    """

    pixels: int = 1024
    """spread over the picture"""
    ticks: int = 200
    """ms of a clip; all but the first 24 are measured"""
    reference_spp: int = 1024
    """of converged light, two halves together"""
    seed: int = 0
    """controls and pixels follow from it"""

    def __post_init__(self) -> None:
        if not SETTLE_TICKS + 2 <= self.ticks <= 10_000:
            raise EvsError(f"ticks is {self.ticks}; give {SETTLE_TICKS + 2} ... 10,000")
        if not 1 <= self.pixels <= 16384:
            raise EvsError(f"pixels is {self.pixels}; give 1 ... 16384")
        if not 2 <= self.reference_spp <= 2 * MAX_SPP or self.reference_spp % 2:
            raise EvsError(
                f"the reference of {self.reference_spp} spp cannot be halved; "
                f"give an even number, 2 ... {2 * MAX_SPP}"
            )

    @property
    def begin_us(self) -> int:
        """Start of the measured time."""
        return TICK_US * (SETTLE_TICKS - 1)

    @property
    def end_us(self) -> int:
        """End of the measured time."""
        return TICK_US * (self.ticks - 1)


@dataclass(frozen=True)
class _Reference:
    """Events of converged light."""

    events: Events
    still: Mask
    own: Measures
    """of one half against the other"""


@dataclass
class ErrorMeter:
    """Measures points on one scene under one camera motion."""

    setup: SceneSetup
    motion: str
    settings: ErrorSettings
    cache: LightCache
    threads: int = 0
    moved: Moved = lambda _samples: None
    lighting: RenderConfig = field(default_factory=RenderConfig)
    """headlight, shadows, fog, haze, units; of the reference too"""
    _renderers: dict[tuple[int, int], ClipRenderer] = field(default_factory=dict)
    _references: dict[str, _Reference] = field(default_factory=dict)
    _found: dict[str, Accuracy] = field(default_factory=dict)

    def error(self, point: SweepPoint) -> Accuracy:
        """Measure the error of a point.

        Raises:
            EvsError: it cannot be measured, for example without its renderer.
        """
        config = point.config
        check_tick(config.model, config.scene.tick_us)
        sensor = metered_sensor(config.sensor, preset_of(point.preset).sensor)
        renderer = self._of(size_of(config.sensor))
        key = digest(
            (
                renderer.clip.camera.width,
                renderer.plain(config.render),
                dataclasses.replace(config.model, chunk=1, labels=False),
                sensor,
                config.scene.tick_us,
                point.value if point.kind == FRAMES else "",
            )
        )
        if key not in self._found:
            reference = self._reference(renderer, sensor)
            events = self._events(point, config, renderer, sensor)
            measures = self._measure(events, reference.events, renderer.clip, reference.still)
            self._found[key] = error_of(measures, reference.own)
        return self._found[key]

    def _of(self, size: tuple[int, int]) -> ClipRenderer:
        """The renderer of a clip of that size; the motion does not depend on the size."""
        if size not in self._renderers:
            settings = self.settings
            fine = TICK_US // FINE_US
            clip = make_clip(
                self.setup,
                self.motion,
                fine * (settings.ticks + AHEAD_TICKS),
                sampled=min(settings.pixels, size[0] * size[1]),
                patch_px=min(PATCH_PX, *size),
                size=size,
                seed=settings.seed,
                look_ticks=fine * settings.ticks,
                tick_us=FINE_US,
            )
            self._renderers[size] = ClipRenderer(clip, self.cache, self.threads, self.moved)
        return self._renderers[size]

    def _reference(self, renderer: ClipRenderer, sensor: SensorConfig) -> _Reference:
        """Reference of a clip: every ms, through the low pass of `sensor`, stepped exactly."""
        if resolve_sensor(sensor).filter != "large_signal":
            sensor = dataclasses.replace(sensor, filter="exact")
        key = digest((renderer.clip.camera.width, sensor))
        if key not in self._references:
            half = dataclasses.replace(
                self.lighting,
                renderer="path",
                spp=self.settings.reference_spp // 2,
                seeds="fixed",
                antialiasing="fixed",
                sampler=RenderConfig.sampler,
            )
            every_ms = instant_indices(TICK_US, self.settings.end_us)
            one, two = (renderer.at(half, every_ms, seed) for seed in HALF_SEEDS)
            converged: F32 = (one + two) * np.float32(0.5)
            still = stands_still(converged)
            found = [
                events_of(light, times_of(every_ms), ModelConfig(), sensor)
                for light in (one, two, converged)
            ]
            own = self._measure(found[1], found[0], renderer.clip, still)
            self._references[key] = _Reference(found[2], still, own)
        return self._references[key]

    def _events(
        self,
        point: SweepPoint,
        config: PipelineConfig,
        renderer: ClipRenderer,
        sensor: SensorConfig,
    ) -> Events:
        render, model, tick_us = config.render, config.model, config.scene.tick_us
        end_us = self.settings.end_us
        delay_us = round(render.delay_ticks * tick_us)
        if delay_us > MAX_DELAY_US:
            raise EvsError(
                f"a cycle of {render.cycle_ticks} ticks of {tick_us} us is {delay_us} us late: "
                f"errors are measured up to {MAX_DELAY_US} us; give fewer render.cycle_ticks"
            )
        if model.name != "evsnet":
            indices = instant_indices(tick_us, end_us + delay_us)
            method = frame_method(point.value) if point.kind == FRAMES else None
            light = renderer.at(render, indices)
            events = events_of(light, times_of(indices), model, sensor, method)
        else:
            late_us = network_model(model, render.noisy_samples).latency_ticks * TICK_US
            light = renderer.at(render, instant_indices(tick_us, end_us + late_us + delay_us))
            warm = None
            if render.seeds == "fresh":
                before = dataclasses.replace(renderer.clip, tick_us=TICK_US).before(WARM)
                earlier = ClipRenderer(before, self.cache, self.threads, self.moved)
                warm = earlier.at(render, range(WARM))
            events = network_events(light, model, render.noisy_samples, warm)
        events["t"] -= delay_us
        return events

    def _measure(self, events: Events, of: Events, clip: Clip, still: Mask) -> Measures:
        begin_us, end_us = self.settings.begin_us, self.settings.end_us
        return measure(events, of, clip, still, begin_us, end_us)


def instant_indices(tick_us: int, end_us: int) -> list[int]:
    """Indices of the instants, FINE_US apart, that a run with such ticks sees up to end_us.

    The nearest ones where a tick is no multiple of FINE_US, as with 60 frames a second.
    """
    if tick_us < FINE_US:
        raise EvsError(f"a tick of {tick_us} us: errors are measured from {FINE_US} us on")
    ticks = -(-end_us // tick_us)
    found = [round(tick * tick_us / FINE_US) for tick in range(ticks + 1)]
    # rounding to the nearest may have stopped short of the end
    while found[-1] * FINE_US < end_us:
        found.append(round((len(found)) * tick_us / FINE_US))
    return found


def times_of(indices: list[int]) -> list[int]:
    """Times of the instants, us."""
    return [FINE_US * k for k in indices]


def size_of(sensor: SensorConfig) -> tuple[int, int]:
    """Width and height, px."""
    found = resolve_sensor(sensor)
    return int(found.width), int(found.height)


def error_of(found: Measures, own: Measures) -> Accuracy:
    """Shares and rates of the sums.

    Args:
        found: measures of the point.
        own: of one half of the reference against the other.
    """
    wanted = found.reference_on + found.reference_off
    events = found.on + found.off
    return Accuracy(
        emd=found.emd,
        emd_reference=own.emd,
        recall=_ratio(found.pairs, wanted),
        precision=_ratio(found.pairs, events),
        spurious_hz=(events - found.pairs) / (found.pixels * found.seconds),
        count_ratio_on=_ratio(found.on, found.reference_on),
        count_ratio_off=_ratio(found.off, found.reference_off),
        delay_ms=1e-3 * found.delay_us,
        timing_ms=1e-3 * found.timing_us,
        recall_reference=_ratio(own.pairs, own.reference_on + own.reference_off),
    )


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else math.nan


@dataclass(frozen=True)
class ErrorsJob:
    """Writes one file with a line for each point: its error, or why there is none."""

    scene: str
    camera: str
    points: tuple[SweepPoint, ...]
    settings: ErrorSettings
    cache: str
    """folder of the light"""

    @property
    def name(self) -> str:
        """Name of the file: a hash of all inputs."""
        configs = [(shaping(point.config), point.kind, point.value) for point in self.points]
        model = digest_of(scene_setup(self.scene).model)
        parts = (self.scene, model, self.camera, configs, dataclasses.asdict(self.settings))
        return f"{digest(parts)}.jsonl"

    def make(self, folder: Path) -> None:
        """Measure the errors."""
        error_meter = ErrorMeter(
            scene_setup(self.scene), self.camera, self.settings, LightCache(Path(self.cache)),
            job_threads(),
        )  # fmt: skip
        lines = []
        for done, point in enumerate(self.points):
            report_progress(done / len(self.points))
            try:
                found = dataclasses.asdict(error_meter.error(point))
            except EvsError as error:
                lines.append(json.dumps({"left_out": str(error)}))
            else:
                lines.append(json.dumps(finite(found)))
        (folder / self.name).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")

    def read(self, target: Path) -> list[Accuracy | str]:
        """Read the file that `make` wrote: errors, or why there is none."""
        found: list[Accuracy | str] = []
        for line in read_small_text(target / self.name).splitlines():
            data = json.loads(line)
            if "left_out" in data:
                found.append(str(data["left_out"]))
            else:
                found.append(Accuracy(**{k: number(v, k) for k, v in data.items()}))
        return found
