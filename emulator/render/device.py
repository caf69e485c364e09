"""Where pixels are rendered: the choice, the protocol, and the CPU. GPUs: render/gpu."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from evs.emulator import _core
from evs.emulator.base.gpu.driver import why_no_gpu
from evs.emulator.base.scene import F32, F64, SceneModel
from evs.emulator.config import RenderConfig
from evs.emulator.render.renderer_table import RENDERERS
from evs.msgs import EvsError

Poses = tuple[F64, F64, F64, F64, F64, F64]
"""of geoms, lights and camera, as Caster.render takes them"""


def device_of(scene: SceneModel, config: RenderConfig, rgb: bool = False) -> str:
    """Where a camera is rendered: "cpu" or "cuda".

    Args:
        scene: What is seen.
        config: [render].
        rgb: Whether colour is wanted beside the luminance.

    Raises:
        EvsError: render.device is cuda, and that cannot be.
    """
    if config.device == "cpu":
        return "cpu"
    reason = _why_not_cuda(scene, config, rgb) or why_no_gpu()
    if reason and config.device == "cuda":
        raise EvsError(f"render.device is cuda, but {reason}; take cpu, or auto")
    return "cpu" if reason else "cuda"


def _why_not_cuda(scene: SceneModel, config: RenderConfig, rgb: bool) -> str:
    """Why no GPU can render this, as a reason; "": one can."""
    row = RENDERERS[config.renderer]
    if not row.cuda:
        able = " and ".join(name for name, row in RENDERERS.items() if row.cuda)
        return f"render.renderer is {config.renderer}, and a GPU renders {able} only"
    if rgb:
        return "colour is rendered on the CPU only"
    if row.paths and config.adaptive:
        return "paths at edges only (render.antialiasing=adaptive) are traced on the CPU"
    if scene.deforming or (row.bounces and len(scene.stretching)):
        return "the scene has shapes that deform"
    return ""


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
