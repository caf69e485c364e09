"""ClipRenderer: light of a clip at some of its instants, by any renderer, cached."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evs.emulator.base.protocols import Renderer, TracingRenderer
from evs.emulator.base.scene import F32
from evs.emulator.config import RenderConfig
from evs.emulator.render.renderer_factory import make_renderer
from evs.emulator.world import versions
from evs_lab.evaluation.clip import Clip
from evs_lab.evaluation.digest import digest
from evs_lab.evaluation.light_cache import LightCache

SEED = 3
"""of the light under test, as in `evs evaluate`; the halves of the reference have 1 and 2"""

_PROBED_PX = 64
_PROBED_SPP = 4

Moved = Callable[[int], None]
"""called with the samples a pixel of each rendered tick"""


def _nothing(_samples: int) -> None:
    pass


@dataclass
class ClipRenderer:
    """Renders the pixels of one clip, or finds their light in the cache."""

    clip: Clip
    cache: LightCache
    threads: int = 0
    moved: Moved = _nothing
    _marks: dict[tuple[int, ...], str] = field(default_factory=dict)
    _recent: dict[tuple[RenderConfig, int], tuple[dict[int, int], F32]] = field(
        default_factory=dict
    )
    """(render, seed) -> the row of each instant, and the light of the largest set of instants"""

    def at(self, render: RenderConfig, indices: Sequence[int], seed: int = SEED) -> F32:
        """Luminance of the clip's pixels at some of its instants.

        Args:
            render: how to render; keys that do not shape light are ignored, and bounces and
                flicker are the scene's.
            indices: of the instants.
            seed: of the noise.

        Returns:
            (len(indices), n) luminance.
        """
        render = self.plain(render)
        chosen = tuple(indices)
        known = self._recent.get((render, seed))
        alone = render.seeds != "cycle" and render.renderer != "hybrid"
        if known is not None and alone and set(chosen) <= known[0].keys():
            # light of an instant follows from it alone, not from the ticks before it
            self.moved(render.samples * len(chosen))
            return known[1][[known[0][k] for k in chosen]]
        done = 0

        def trace() -> F32:
            nonlocal done
            renderer = self._renderer(render, seed, self.threads)
            light = np.empty((len(chosen), len(self.clip.pixels)), np.float32)
            for row, k in enumerate(chosen):
                light[row] = self._pixels(renderer, k)
                self.moved(render.samples)
                done += 1
            return light

        key = self._key(render, chosen, seed)
        light = self.cache.get(key, (len(chosen), len(self.clip.pixels)), trace)
        self.moved(render.samples * (len(chosen) - done))
        if known is None or len(chosen) > len(known[0]):
            self._recent[render, seed] = {k: row for row, k in enumerate(chosen)}, light
        return light

    def plain(self, render: RenderConfig) -> RenderConfig:
        """Set all that does not shape light to its default, and take the scene's own keys."""
        default = RenderConfig()
        render = render.for_scene(self.clip.scene.has_meshes)
        return dataclasses.replace(
            render,
            spp=render.samples,
            antialiasing="adaptive" if render.adaptive else "fixed",
            bounces=self.clip.bounces,
            flicker=self.clip.flicker,
            sky=self.clip.sky,
            incremental=default.incremental,
            isa=default.isa,
        )

    def _renderer(self, render: RenderConfig, seed: int, threads: int) -> Renderer:
        return make_renderer(self.clip.scene, self.clip.camera, render, threads, seed=seed)

    def _pixels(self, renderer: Renderer, k: int, step: int = 1) -> F32:
        pixels = self.clip.pixels[::step]
        if isinstance(renderer, TracingRenderer):
            return renderer.trace(*self.clip.instants[k], pixels)
        # others draw whole pictures only
        return np.asarray(renderer.render(*self.clip.instants[k])[pixels[:, 1], pixels[:, 0]])

    def _key(self, render: RenderConfig, indices: tuple[int, ...], seed: int) -> str:
        """Hash of all that shapes the light, and of some traced pixels, as in `evs evaluate`."""
        if indices not in self._marks:
            part = dataclasses.replace(
                self.clip, instants=tuple(self.clip.instants[k] for k in indices)
            )
            self._marks[indices] = part.fingerprint(len(indices))
        probed = dataclasses.replace(render, spp=min(render.samples, _PROBED_SPP))
        renderer = self._renderer(probed, seed, 1)
        step = max(1, len(self.clip.pixels) // _PROBED_PX)
        probe: list[Any] = [self._pixels(renderer, k, step) for k in (indices[0], indices[-1])]
        return digest((self._marks[indices], dataclasses.asdict(render), seed, versions(), probe))
