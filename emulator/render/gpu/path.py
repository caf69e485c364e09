"""The `path` renderer on a GPU: the kernel of the native core, a sample a thread."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.gpu.compiler import kernels_of
from evs.emulator.base.gpu.driver import DeviceMemory, the_gpu
from evs.emulator.base.scene import F32, CameraModel, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.config import RenderConfig
from evs.emulator.render.direct import DirectRenderer, LentRenderer
from evs.emulator.render.gpu.renderer import CudaRenderer
from evs.emulator.render.gpu.scene import UploadedScene
from evs.emulator.render.path import PathRenderer

MOST_BYTES = 256 * 2**20
"""of the light of samples that is kept until it is added up"""


class CudaPathRenderer(CudaRenderer, PathRenderer):
    """`path` with the bytes of the CPU. Every tick is rendered as a whole."""

    def __init__(
        self,
        scene: SceneModel,
        camera: CameraModel,
        config: RenderConfig,
        threads: int,
        rgb: bool = False,
        seed: int = 0,
        switches: Switches = UNFORCED,
        like: DirectRenderer | None = None,
        point_set: int = 0,
    ) -> None:
        """Copy the scene to the GPU, and compile the kernels unless they are in the cache.

        Args:
            scene: As of DirectRenderer, without shapes that deform or stretch.
            camera: As of DirectRenderer.
            config: As of DirectRenderer, without adaptive antialiasing.
            threads: As of DirectRenderer, of what the CPU does.
            rgb: False.
            seed: As of PathRenderer.
            switches: As of DirectRenderer.
            like: As of DirectRenderer.
            point_set: As of PathRenderer.

        Raises:
            EvsError: There is no GPU, or no memory on it.
        """
        gpu = the_gpu()
        super().__init__(scene, camera, config, threads, rgb, seed, switches, like, point_set)
        self._there = UploadedScene(gpu, self._caster, self.shape)
        image = self._luminance.nbytes
        self._samples = config.samples
        self._at_once = max(1, min(self._samples, MOST_BYTES // (3 * image)))
        room = self._there.room
        self._radiance: DeviceMemory
        self._sums: DeviceMemory
        if isinstance(like, CudaPathRenderer) and like._fits(self):
            # they take turns, as those of a cycle do
            self._radiance, self._sums = like._radiance, like._sums
        else:
            self._radiance, self._sums = room(3 * self._at_once * image), room(6 * image)
        self._trace, self._add = kernels_of(
            gpu, "render/path", ("trace_samples", "add_samples"), {}
        )

    def _fits(self, other: CudaPathRenderer) -> bool:
        """Whether another one needs as much room."""
        return self.shape == other.shape and self._at_once == other._at_once

    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """As of PathRenderer."""
        self._noise = self._noise_of(snapshot)
        there = self._there
        there.upload(self._place(snapshot, pose), self._noise)
        radiance, sums, light = self._radiance.argument, self._sums.argument, there.target(into)
        for begin in range(0, self._samples, self._at_once):
            count = min(self._at_once, self._samples - begin)
            first, many = np.array([begin], np.int32), np.array([count], np.int32)
            there.launch(self._trace, there.frame, there.paths, first, radiance, deep=count)
            there.launch(self._add, there.frame, first, many, radiance, sums, light)
        return there.download(into)

    def lend(self) -> LentRenderer | str:
        """As of PathRenderer."""
        return "a GPU renders paths camera by camera"
