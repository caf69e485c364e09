"""`path` on a GPU: the kernel of the native core, a sample a thread."""

from __future__ import annotations

import numpy as np

from evs.emulator import _core
from evs.emulator.base.gpu.compiler import kernels_of
from evs.emulator.base.gpu.driver import DeviceMemory, the_gpu
from evs.emulator.base.scene import F32
from evs.emulator.render.device import Poses
from evs.emulator.render.gpu.scene import GpuDevice

MOST_BYTES = 256 * 2**20
"""of the light of samples that is kept until it is added up"""


class PathOnGpu(GpuDevice):
    """The bytes of the CPU. Every tick is rendered as a whole."""

    why_not_lent = "a GPU renders paths camera by camera"

    def __init__(
        self, caster: _core.Caster, shape: tuple[int, int], samples: int, shared: object
    ) -> None:
        """See GpuDevice."""
        gpu = the_gpu()
        super().__init__(gpu, caster, shape)
        image = self.luminance.nbytes
        self._samples = samples
        self._at_once = max(1, min(samples, MOST_BYTES // (3 * image)))
        self._radiance: DeviceMemory
        self._sums: DeviceMemory
        if isinstance(shared, PathOnGpu) and shared._fits(self):
            # they take turns, as those of a cycle do
            self._radiance, self._sums = shared._radiance, shared._sums
        else:
            room = self._scene.room
            self._radiance, self._sums = room(3 * self._at_once * image), room(6 * image)
        self._trace, self._add = kernels_of(
            gpu, "render/path", ("trace_samples", "add_samples"), {}
        )

    def _fits(self, other: PathOnGpu) -> bool:
        """Whether another one needs as much room."""
        return self.luminance.shape == other.luminance.shape and self._at_once == other._at_once

    def render(self, poses: Poses, seed: int, into: F32 | None) -> F32:
        """See Device."""
        scene = self._scene
        scene.upload(poses, seed)
        radiance, sums, light = self._radiance.argument, self._sums.argument, scene.target(into)
        for begin in range(0, self._samples, self._at_once):
            count = min(self._at_once, self._samples - begin)
            first, many = np.array([begin], np.int32), np.array([count], np.int32)
            scene.launch(self._trace, scene.frame, scene.paths, first, radiance, deep=count)
            scene.launch(self._add, scene.frame, first, many, radiance, sums, light)
        return scene.download(into)
