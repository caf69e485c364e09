"""`direct` on a GPU: the kernel of the native core, a pixel a thread."""

from __future__ import annotations

from evs.emulator import _core
from evs.emulator.base.gpu.compiler import kernels_of
from evs.emulator.base.gpu.driver import the_gpu
from evs.emulator.base.scene import F32
from evs.emulator.render.device import Poses
from evs.emulator.render.gpu.scene import GpuDevice


class DirectOnGpu(GpuDevice):
    """The bytes of the CPU. Every tick is rendered as a whole."""

    def __init__(
        self, caster: _core.Caster, shape: tuple[int, int], samples: int, shared: object
    ) -> None:
        """See GpuDevice."""
        del samples, shared
        gpu = the_gpu()
        super().__init__(gpu, caster, shape)
        adaptive = self._scene.adaptive
        self._untextured = self._scene.room(self.luminance.nbytes if adaptive else 0)
        names = ("first_pass", "second_pass") if adaptive else ("direct",)
        macros = {"EVS_CHANNELS": caster.channels, "EVS_ADAPTIVE": int(adaptive)}
        self._kernels = kernels_of(gpu, "render/direct", names, macros)
        if adaptive:
            self.why_not_lent = (
                "a GPU renders samples at edges camera by camera; take render.antialiasing=fixed"
            )
        else:
            self.why_not_lent, self.uploaded = "", self._scene

    def render(self, poses: Poses, seed: int, into: F32 | None) -> F32:
        """See Device."""
        del seed
        scene = self._scene
        scene.upload(poses)
        light = scene.target(into)
        if scene.adaptive:
            first, second = self._kernels
            untextured = self._untextured.argument
            scene.launch(first, scene.first_pass, light, untextured)
            scene.launch(second, scene.frame, untextured, light)
        else:
            scene.launch(self._kernels[0], scene.frame, light)
        return scene.download(into)
