"""Render the light of a clip at its pixels, or find it in the cache."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from evs.emulator.base.protocols import TracingRenderer
from evs.emulator.base.scene import F32
from evs.emulator.config import RenderConfig
from evs.emulator.render import make_renderer
from evs.emulator.world import versions
from evs_lab.evaluation.clip import Clip
from evs_lab.evaluation.digest import digest
from evs_lab.evaluation.light_cache import LightCache

SEED = 3
"""of the light under test; the halves of the reference have 1 and 2"""
HALF_SEEDS = (1, 2)
WARM = 42
"""ticks of the first instant with fresh noise, which a network sees before the clip: its window"""

_PROBED_PX = 64
_PROBED_SPP = 4


@dataclass(frozen=True)
class LightSpec:
    """How light is traced."""

    renderer: str
    """direct | hybrid | path"""
    spp: int
    seeds: str = "fixed"
    """fixed | fresh | cycle"""
    seed: int = SEED
    """of the noise"""
    antialiasing: str = "fixed"
    """fixed | adaptive"""

    @property
    def noisy_samples(self) -> int:
        """As RenderConfig.noisy_samples."""
        return self.render.noisy_samples

    @property
    def render(self) -> RenderConfig:
        """The renderer's configuration, without what the scene decides."""
        return RenderConfig(
            renderer=self.renderer,
            spp=self.spp,
            seeds=self.seeds,
            antialiasing=self.antialiasing,
        )


def renderer_of(clip: Clip, spec: LightSpec, threads: int) -> TracingRenderer:
    """The renderer of a clip.

    Raises:
        EvsError: no renderer has these settings.
    """
    config = replace(spec.render, bounces=clip.bounces, flicker=clip.flicker, sky=clip.sky)
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
    renderer = renderer_of(clip, replace(spec, spp=min(spec.spp, _PROBED_SPP)), 1)
    step = max(1, len(clip.pixels) // _PROBED_PX)
    some = clip.pixels[::step]
    probe = [renderer.trace(*clip.instants[k], some) for k in (0, ticks - 1)]
    told = asdict(spec)
    if spec.antialiasing == "fixed":
        # keys of light that was traced before there was a choice stay valid
        del told["antialiasing"]
    return digest((fingerprint, told, ticks, versions(), probe))


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


class NoisyLight:
    """The lights under test of one clip."""

    def __init__(
        self,
        clip: Clip,
        ticks: int,
        cache: LightCache,
        threads: int,
        moved: Callable[[int], None],
    ) -> None:
        """Hash the clip.

        Args:
            clip: the clip.
            ticks: how many of it, with those that a model looks ahead.
            cache: holds the light.
            threads: worker threads; 0: one per core.
            moved: as of `light_of`.
        """
        before = clip.before(WARM)
        self._clip = clip, clip.fingerprint(ticks), ticks
        self._before = before, before.fingerprint(WARM), WARM
        self._cache, self._threads, self._moved = cache, threads, moved

    def of(self, spec: LightSpec) -> tuple[F32, F32 | None]:
        """(ticks, n) light, and of fresh seeds (WARM, n) light of the scene at rest before."""
        light = self._traced(self._clip, spec)
        return light, self._traced(self._before, spec) if spec.seeds == "fresh" else None

    def _traced(self, part: tuple[Clip, str, int], spec: LightSpec) -> F32:
        clip, fingerprint, ticks = part
        return light_of(clip, fingerprint, spec, ticks, self._cache, self._threads, self._moved)
