"""Run the evaluation: every model on every light of every clip."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.run.report import versions
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import most_events
from evs.emulator.sensor.pixel import log_light
from evs.emulator.world import versions as emulator_versions
from evs.msgs import Events, EvsError
from evs_lab.evaluation import models, scenes
from evs_lab.evaluation.aggregate import ResultCell
from evs_lab.evaluation.claims import NOTHING, REFERENCE
from evs_lab.evaluation.clip import MOTIONS, PATCH_PX, SIZE, TICK_US, Clip, make_clip
from evs_lab.evaluation.clip_light import HALF_SEEDS, WARM, LightSpec, NoisyLight, light_of
from evs_lab.evaluation.light_cache import LightCache
from evs_lab.evaluation.measure import Mask, measure
from evs_lab.evaluation.models import RuntimeOptions
from evs_lab.evaluation.table import ClipFacts, Evaluation

SPP = (1, 4, 16, 64)
SEEDS = ("fixed", "fresh", "cycle")
MAX_SPP = 4096
K = 384
"""ticks that are measured, the last ones of a clip"""
DIRECT_SPP = 4
HYBRID_SPP = (4, 16)
CYCLE_LATE = 2
"""ticks by which moving light is late in a cycle of seeds, rounded up"""
STILL = 0.05
"""log units, a quarter of a threshold: a pixel whose converged light varies by less stands still,
and every event on it is false"""


@dataclass(frozen=True)
class EvaluationSettings:
    """What is evaluated.

    Raises:
        EvsError: a value is out of range.
    """

    scenes: tuple[str, ...] = scenes.DEFAULT
    cameras: tuple[str, ...] = ("still", "pan")
    spp: tuple[int, ...] = SPP
    models: tuple[str, ...] = models.DEFAULT
    network: Path | None = None
    """a user's own, besides"""
    ticks: int = 400
    pixels: int = 4096
    reference_spp: int = 1024
    runtime: str = "native"
    provider: str = "cpu"
    events_per_tick: str = "auto"
    """of the networks, as model.events_per_tick"""
    threads: int = 0
    seed: int = 0
    size: tuple[int, int] = SIZE
    patch_px: int = PATCH_PX

    def __post_init__(self) -> None:
        object.__setattr__(self, "scenes", scenes.check_names(self.scenes))
        if self.events_per_tick != "auto":
            most_events(self.events_per_tick)
        if not self.models and self.network is None:
            raise EvsError("no model is given; give for example plain,adaptive")
        for spp in self.spp:
            if not 1 <= spp <= MAX_SPP:
                raise EvsError(f"spp is {spp}; give 1 ... {MAX_SPP}")
        if not 2 <= self.reference_spp <= 2 * MAX_SPP or self.reference_spp % 2:
            raise EvsError(
                f"the reference of {self.reference_spp} spp cannot be halved; "
                f"give an even number, 2 ... {2 * MAX_SPP}"
            )
        if not 3 <= self.ticks <= 100_000:
            raise EvsError(f"ticks is {self.ticks}; give 3 ... 100,000")
        for what, values in (("camera", self.cameras), ("spp", self.spp), ("model", self.models)):
            if len(set(values)) < len(values):
                raise EvsError(f"a {what} is given twice in {', '.join(map(str, values))}")
        if not (self.cameras and self.spp):
            raise EvsError(f"give at least one camera ({', '.join(MOTIONS)}) and one spp")

    @property
    def how(self) -> RuntimeOptions:
        """How models are run."""
        return RuntimeOptions(self.threads, self.runtime, self.provider, self.events_per_tick)

    @property
    def measured_ticks(self) -> int:
        """The last ticks of a clip; those before let running means and windows settle."""
        return min(K, self.ticks - 1)

    def plain(self) -> dict[str, Any]:
        """Plain values, for a report."""
        network = None if self.network is None else str(self.network)
        return {**asdict(self), "network": network}


QUICK = EvaluationSettings(
    scenes=scenes.QUICK,
    spp=(4, 16),
    pixels=512,
    patch_px=16,
    ticks=200,
    reference_spp=256,
)
"""A first impression."""

Moved = Callable[[int, str], None]
"""(samples a pixel and tick done so far, what is being done)"""


def lights(settings: EvaluationSettings) -> Iterator[LightSpec]:
    """The lights on which models are judged."""
    for seeds in SEEDS:
        for spp in settings.spp:
            yield LightSpec("path", spp, seeds)
    yield LightSpec("direct", DIRECT_SPP)
    for spp in HYBRID_SPP:
        yield LightSpec("hybrid", spp)
    yield LightSpec("hybrid", max(HYBRID_SPP), antialiasing="adaptive")


def work(settings: EvaluationSettings, latency: int) -> int:
    """Samples a pixel and tick of the whole evaluation: the length of its progress bar."""
    clips = len(settings.scenes) * len(settings.cameras)
    noisy = sum(spec.spp for spec in lights(settings)) * (settings.ticks + latency)
    warm = sum(spec.spp for spec in lights(settings) if spec.seeds == "fresh") * WARM
    return clips * (noisy + warm + settings.reference_spp * settings.ticks)


def evaluate(
    settings: EvaluationSettings,
    cache: LightCache,
    models_under_test: Sequence[models.ModelUnderTest],
    moved: Moved | None = None,
    command: str = "",
) -> Evaluation:
    """Run the evaluation. Rendered light stays in the cache, even after an error.

    Args:
        settings: what is evaluated.
        cache: holds the light.
        models_under_test: the models.
        moved: called with the progress.
        command: the command line, for the report.
    """
    setups = [scenes.scene_setup(name) for name in settings.scenes]
    result = Evaluation(command, settings.plain(), {**versions(), **emulator_versions()})
    latency = look_ahead(models_under_test)
    done = 0
    for setup in setups:
        for motion in settings.cameras:
            clip = make_clip(
                setup,
                motion,
                settings.ticks + latency,
                sampled=settings.pixels,
                patch_px=settings.patch_px,
                size=settings.size,
                seed=settings.seed,
                look_ticks=settings.ticks,
            )

            def step(samples: int, what: str = clip.name) -> None:
                nonlocal done
                done += samples
                if moved is not None:
                    moved(done, what)

            facts, cells = _judge(clip, settings, cache, models_under_test, latency, step)
            result.clips.append(facts)
            result.cells.extend(cells)
    return result


def look_ahead(models_under_test: Sequence[models.ModelUnderTest]) -> int:
    """Ticks of light after the last measured one that a model needs, in steps of 24.

    The steps let models of different latency find the same light in the cache.
    """
    most = max((one.latency_ticks for one in models_under_test), default=0)
    # and a cycle of seeds is late too
    return 24 * max(1, -(-(most + CYCLE_LATE) // 24))


def _judge(
    clip: Clip,
    settings: EvaluationSettings,
    cache: LightCache,
    models_under_test: Sequence[models.ModelUnderTest],
    latency: int,
    step: Callable[[int], None],
) -> tuple[ClipFacts, list[ResultCell]]:
    """All cells of one clip."""
    ticks, threads = settings.ticks, settings.threads
    begin_us, end_us = TICK_US * (ticks - 1 - settings.measured_ticks), TICK_US * (ticks - 1)
    key = clip.fingerprint(ticks)
    one, two = (
        light_of(clip, key, LightSpec("path", settings.reference_spp // 2, seed=seed), ticks,
                 cache, threads, step)
        for seed in HALF_SEEDS
    )  # fmt: skip
    converged: F32 = (one + two) * np.float32(0.5)
    reference = models.reference_events(converged, threads)
    still = stands_still(converged)

    def cell(
        spec: LightSpec, light: str, model: str, events: Events, ms: float, of: Events
    ) -> ResultCell:
        found = measure(events, of, clip, still, begin_us, end_us, ms)
        return ResultCell(
            clip.scene_name, clip.motion, clip.soft, light, spec.spp, spec.seeds, model, found,
            spec.antialiasing,
        )  # fmt: skip

    half = LightSpec("path", settings.reference_spp // 2)
    halves = [models.reference_events(light, threads) for light in (one, two)]
    cells = [
        cell(half, "converged", REFERENCE, halves[1], 0.0, halves[0]),
        cell(replace(half, spp=0), "none", NOTHING, reference[:0], 0.0, reference),
    ]
    noisy = NoisyLight(clip, ticks + latency, cache, threads, step)
    for spec in lights(settings):
        light, warm = noisy.of(spec)
        for tested in models_under_test:
            out = run_on(tested, spec, light, warm)
            cells.append(
                cell(spec, spec.renderer, tested.name, out.events, out.ms_per_tick, reference)
            )
    patch = clip.pixels[clip.sampled]
    wanted = cells[1].measures
    facts = ClipFacts(
        clip.scene_name,
        clip.motion,
        clip.soft,
        clip.sampled,
        wanted.static_px,
        (int(patch[0]), int(patch[1]), clip.patch_px),
        wanted.reference_on + wanted.reference_off,
        wanted.patch_reference,
    )
    return facts, cells


def run_on(
    tested: models.ModelUnderTest, spec: LightSpec, light: F32, warm: F32 | None
) -> models.ModelOutput:
    """Run a model as `models.run` does; the delay of a cycle of seeds is subtracted too."""
    out = models.run(tested.at(spec.noisy_samples), light, warm)
    out.events["t"] -= round(TICK_US * spec.render.delay_ticks)
    return out


def stands_still(light: F32) -> Mask:
    """Find the pixels whose log light varies by less than STILL in all.

    Args:
        light: (ticks, n).

    Returns:
        (n,).
    """
    log = log_light(light, models.sensor_of(1))
    still: Mask = np.ptp(log, axis=0) < STILL
    return still
