"""The `hybrid` renderer: direct light at every pixel, diffuse light of sky and bounces cached."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F32, I32, CameraPose, SceneSnapshot
from evs.emulator.render.path import PathRenderer
from evs.emulator.state import number, numbers
from evs.msgs import EvsError

MAX_COARSER = 20
KEYS, LIGHT = 7, 27
"""numbers of a node: irradiance_cache.h"""
DAMAGED = "saved state is damaged: the cache of the renderer is invalid; save it again"


class HybridRenderer(PathRenderer):
    """Soft light without noise: what changes fast is traced, what changes slowly is cached.

    Lamps, glowing geoms, gloss and mirrors are evaluated at every pixel of every tick. The diffuse
    light of the sky and of bounces is cached on surfaces and follows changes within 96 ticks. The
    cache begins empty and is filled before the first light is given. Its paths follow from the
    seed.
    """

    integrator = "hybrid"

    def trace(self, snapshot: SceneSnapshot, pose: CameraPose, pixels: I32) -> F32:
        """As of the direct renderer, of the next tick: the cache is that of a tick."""
        columns, rows = np.asarray(pixels).T
        traced: F32 = self.render(snapshot, pose)[rows, columns]
        return traced

    def restart(self) -> None:
        """Forget the cached light: the next tick fills the cache anew."""
        self._caster.restart()

    def render_again(self, snapshot: SceneSnapshot, pose: CameraPose) -> F32:
        """As of Renderer."""
        del snapshot, pose
        return self._luminance

    def save(self) -> dict[str, Any]:
        """Named arrays of the cache and of the last light, which `prepare_restore` takes back."""
        nodes = self._caster.work["cache_nodes"]
        keys, light = np.empty((nodes, KEYS), np.int32), np.empty((nodes, LIGHT), np.float32)
        tick, coarser = self._caster.save_irradiance(keys, light)
        saved: dict[str, Any] = {"keys": keys, "light": light, "luminance": self._luminance.copy()}
        if self._rgb is not None:
            saved["rgb"] = self._rgb.copy()
        return {**saved, **numbers(tick=tick, coarser=coarser)}

    def prepare_restore(self, saved: Mapping[str, Any]) -> Commit:
        """Check a saved cache; the commit puts it in place.

        Raises:
            EvsError: It is damaged.
        """
        tick = number(saved, "tick", 0)
        coarser = number(saved, "coarser", 0, MAX_COARSER)
        keys = _array(saved, "keys", np.int32, (-1, KEYS))
        light = _array(saved, "light", np.float32, (len(keys), LIGHT))
        pictures: list[tuple[F32, F32]]
        pictures = [(self._luminance, _array(saved, "luminance", np.float32, self.shape))]
        if self._rgb is not None:
            pictures.append((self._rgb, _array(saved, "rgb", np.float32, self._rgb.shape)))

        # only the core can check all of it, and puts it in place if it is sound
        own = self.save()
        if not self._caster.restore_irradiance(tick, coarser, keys, light):
            raise EvsError(DAMAGED)
        own_numbers = int(own["tick"]), int(own["coarser"])
        self._caster.restore_irradiance(*own_numbers, own["keys"], own["light"])

        def commit() -> None:
            self._caster.restore_irradiance(tick, coarser, keys, light)
            for now, before in pictures:
                now[:] = before

        return commit


def _array(saved: Mapping[str, Any], name: str, dtype: type, shape: tuple[int, ...]) -> Any:
    """An array of a saved state; -1: any length. EvsError where it is another."""
    array = saved.get(name)
    if not isinstance(array, np.ndarray) or array.dtype != dtype or array.ndim != len(shape):
        raise EvsError(DAMAGED)
    if any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True)):
        raise EvsError(DAMAGED)
    return np.ascontiguousarray(array)
