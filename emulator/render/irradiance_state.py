"""What `hybrid` keeps from tick to tick: the irradiance cache, and the last light."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evs.emulator import _core
from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F32
from evs.emulator.render.device import Device
from evs.emulator.state import number, numbers
from evs.msgs import EvsError

MAX_COARSER = 20
KEYS, LIGHT = 7, 27
"""numbers of a node: irradiance_cache.h"""
DAMAGED = "saved state is damaged: the cache of the renderer is invalid; save it again"


class IrradianceState:
    """The irradiance cache of a caster and the images of its last tick, as a state."""

    def __init__(self, caster: _core.Caster, device: Device, rgb: F32 | None) -> None:
        """Begin with an empty cache, which the next tick fills.

        Args:
            caster: Of `hybrid`.
            device: Where its pixels are traced.
            rgb: (h, w, 3) colour of the last tick; None: there is none.
        """
        self._caster, self._device, self._rgb = caster, device, rgb

    def restart(self) -> None:
        """Forget the cached light: the next tick fills the cache anew."""
        self._caster.restart()

    def save(self) -> dict[str, Any]:
        """Named arrays of the cache and of the last light, which `prepare_restore` takes back."""
        self._device.fetch()
        nodes = self._caster.work["cache_nodes"]
        keys, light = np.empty((nodes, KEYS), np.int32), np.empty((nodes, LIGHT), np.float32)
        tick, coarser = self._caster.save_irradiance(keys, light)
        saved: dict[str, Any] = {
            "keys": keys,
            "light": light,
            "luminance": self._device.luminance.copy(),
        }
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
        luminance = self._device.luminance
        pictures: list[tuple[F32, F32]]
        pictures = [(luminance, _array(saved, "luminance", np.float32, luminance.shape))]
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
            self._device.replace_light()

        return commit


def _array(saved: Mapping[str, Any], name: str, dtype: type, shape: tuple[int, ...]) -> Any:
    """An array of a saved state; -1: any length. EvsError where it is another."""
    array = saved.get(name)
    if not isinstance(array, np.ndarray) or array.dtype != dtype or array.ndim != len(shape):
        raise EvsError(DAMAGED)
    if any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True)):
        raise EvsError(DAMAGED)
    return np.ascontiguousarray(array)
