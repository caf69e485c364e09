"""Render the light of a clip at its pixels, or find it in the cache."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from evs.emulator.base.protocols import TracingRenderer
from evs.emulator.base.scene import F32
from evs.emulator.config import RenderConfig
from evs.emulator.render import make_renderer
from evs.emulator.state.versions import versions
from evs.tools.evaluation.clip import Clip
from evs.tools.evaluation.digest import digest
from evs.tools.evaluation.light_cache import LightCache

SEED = 3
"""of the light under test; the halves of the reference have 1 and 2"""
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
    """fixed | fresh | cycle"""
    seed: int = SEED
    """of the noise"""

    @property
    def noisy_samples(self) -> int:
        """As RenderConfig.noisy_samples."""
        return self.render.noisy_samples

    @property
    def render(self) -> RenderConfig:
        """The renderer's configuration, without what the scene decides."""
        return RenderConfig(renderer=self.renderer, spp=self.spp, seeds=self.seeds)


def renderer_of(clip: Clip, spec: LightSpec, threads: int) -> TracingRenderer:
    """The renderer of a clip.

    Raises:
        EvsError: no renderer has these settings.
    """
    config = replace(spec.render, bounces=clip.bounces, flicker=clip.flicker)
    made = make_renderer(clip.scene, clip.camera, config, threads, seed=spec.seed)
    assert isinstance(made, TracingRenderer)
    return made


def light_key(clip: Clip, fingerprint: str, spec: LightSpec, ticks: int) -> str:
    """Hash of everything that shapes the light: scene, instants, pixels, settings, versions.

    A few traced pixels are part of the key, so that light of an earlier version of the tracer is
    not taken from the cache.

    Args:
        clip: the clip.
        fingerprint: of the clip and these ticks.
        spec: how light is traced.
        ticks: how many.
    """
    probed = LightSpec(spec.renderer, min(spec.spp, _PROBED_SPP), spec.seeds, spec.seed)
    renderer = renderer_of(clip, probed, 1)
    step = max(1, len(clip.pixels) // _PROBED_PX)
    some = clip.pixels[::step]
    probe = [renderer.trace(*clip.instants[k], some) for k in (0, ticks - 1)]
    return digest((fingerprint, asdict(spec), ticks, versions(), probe))


def light_of(
    clip: Clip,
    fingerprint: str,
    spec: LightSpec,
    ticks: int,
    cache: LightCache,
    threads: int,
    moved: Callable[[int], None],
) -> F32:
    """(ticks, n) luminance of the clip's pixels.

    Args:
        clip: the clip.
        fingerprint: of the clip.
        spec: how light is traced.
        ticks: how many.
        cache: holds the light.
        threads: worker threads; 0: one per core.
        moved: called with the samples per pixel of each tick; if the cache has them, with all at
            once.
    """
    done = 0

    def trace() -> F32:
        nonlocal done
        renderer = renderer_of(clip, spec, threads)
        light = np.empty((ticks, len(clip.pixels)), np.float32)
        for k in range(ticks):
            light[k] = renderer.trace(*clip.instants[k], clip.pixels)
            moved(spec.spp)
            done += 1
        return light

    key = light_key(clip, fingerprint, spec, ticks)
    light = cache.get(key, (ticks, len(clip.pixels)), trace)
    moved(spec.spp * (ticks - done))
    return light
