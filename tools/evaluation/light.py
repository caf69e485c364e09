"""Light of a take, traced at its pixels, or found in the cache."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.config import RenderConfig
from evs.emulator.render.direct import DirectRenderer
from evs.emulator.render.path import PathRenderer
from evs.emulator.render.renderers import check_render
from evs.emulator.state.versions import versions
from evs.tools.evaluation.cache import LightCache
from evs.tools.evaluation.digest import digest
from evs.tools.evaluation.take import Take

SEED = 3
"""of the light that is judged; the halves of the reference have 1 and 2"""
HALF_SEEDS = (1, 2)

_PROBED_PX = 64
_PROBED_SPP = 4


@dataclass(frozen=True)
class LightSpec:
    """How light is traced."""

    renderer: str
    """direct | path"""
    spp: int
    seeds: str = "fixed"
    """fixed | fresh"""
    seed: int = SEED
    """what the noise follows from"""

    @property
    def noisy_samples(self) -> int:
        """As RenderConfig.noisy_samples."""
        return RenderConfig(renderer=self.renderer, spp=self.spp).noisy_samples


def renderer_of(take: Take, spec: LightSpec, threads: int) -> DirectRenderer:
    """What traces the take as told. Raises EvsError for what no renderer does."""
    config = RenderConfig(
        renderer=spec.renderer,
        spp=spec.spp,
        seeds=spec.seeds,
        bounces=take.bounces,
        flicker=take.flicker,
    )
    check_render(config)
    if spec.renderer == "path":
        return PathRenderer(take.scene, take.camera, config, threads, seed=spec.seed)
    return DirectRenderer(take.scene, take.camera, config, threads)


def light_key(take: Take, fingerprint: str, spec: LightSpec, ticks: int) -> str:
    """Hash of everything that shapes the light: scene, instants, pixels, settings, versions.

    In: fingerprint, of the take and these ticks. A few pixels are traced and belong to the key, so
    that a tracer that has changed does not pass for the one that filled the cache.
    """
    probed = LightSpec(spec.renderer, min(spec.spp, _PROBED_SPP), spec.seeds, spec.seed)
    renderer = renderer_of(take, probed, 1)
    step = max(1, len(take.pixels) // _PROBED_PX)
    some = take.pixels[::step]
    probe = [renderer.trace(*take.shots[k], some) for k in (0, ticks - 1)]
    return digest((fingerprint, asdict(spec), ticks, versions(), probe))


def light_of(
    take: Take,
    fingerprint: str,
    spec: LightSpec,
    ticks: int,
    cache: LightCache,
    threads: int,
    moved: Callable[[int], None],
) -> F32:
    """(ticks, n) luminance of the take's pixels.

    In: moved, called with the samples a pixel that each tick took, all at once where the cache
    has them.
    """
    done = 0

    def trace() -> F32:
        nonlocal done
        renderer = renderer_of(take, spec, threads)
        light = np.empty((ticks, len(take.pixels)), np.float32)
        for k in range(ticks):
            light[k] = renderer.trace(*take.shots[k], take.pixels)
            moved(spec.spp)
            done += 1
        return light

    key = light_key(take, fingerprint, spec, ticks)
    light = cache.get(key, (ticks, len(take.pixels)), trace)
    moved(spec.spp * (ticks - done))
    return light
