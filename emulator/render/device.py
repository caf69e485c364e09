"""Where the native renderer traces its pixels: the protocol, and the CPU. GPUs: render/gpu."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from evs.emulator import _core
from evs.emulator.base.scene import F32, F64

Poses = tuple[F64, F64, F64, F64, F64, F64]
"""of geoms, lights and camera, as Caster.render takes them"""


class Device(Protocol):
    """Where the pixels of one caster are traced."""

    luminance: F32
    """(h, w) light of the last `render` that was not given `into`, after `fetch`"""
    uploaded: object
    """what of the scene is on a GPU and can be lent to a batch; None: nothing"""
    why_not_lent: str
    """why no batch can render in its place; "": one can"""

    def render(self, poses: Poses, seed: int, into: F32 | None) -> F32:
        """Render one instant.

        Args:
            poses: Where everything is.
            seed: Of the noise.
            into: See `Renderer`.

        Returns:
            (h, w) float32 linear luminance.
        """

    def fetch(self) -> None:
        """Bring the light of the last tick into `luminance`."""

    def replace_light(self) -> None:
        """Take `luminance`, which has changed, as the light of the last tick."""


class Cpu:
    """The CPU traces what may have changed."""

    uploaded: object = None
    why_not_lent = ""

    def __init__(self, caster: _core.Caster, shape: tuple[int, int], rgb: F32 | None) -> None:
        """Make the image.

        Args:
            caster: What traces.
            shape: Height and width, px.
            rgb: (h, w, 3) where colour goes; None: it is not wanted.
        """
        self._caster, self._rgb = caster, rgb
        self.luminance = np.zeros(shape, np.float32)

    def render(self, poses: Poses, seed: int, into: F32 | None) -> F32:
        """See Device."""
        self._caster.render(*poses, self.luminance, self._rgb, seed, into)
        return self.luminance if into is None else into

    def fetch(self) -> None:
        """See Device: it is there."""

    def replace_light(self) -> None:
        """See Device: the next tick reads `luminance` itself."""
