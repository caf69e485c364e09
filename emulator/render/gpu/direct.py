"""The `direct` renderer on a GPU: the kernel of the native core, a pixel a thread."""

from __future__ import annotations

import numpy as np

from evs.emulator import _core
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import F32, CameraModel, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.config import RenderConfig
from evs.emulator.render.direct import DirectRenderer, LentRenderer
from evs.emulator.render.gpu.compiler import cached_kernel
from evs.emulator.render.gpu.driver import the_gpu

THREADS = 128
"""of a block: 8 x 16 pixels"""


class CudaDirectRenderer(DirectRenderer):
    """`direct` with the bytes of the CPU. Every tick is rendered as a whole.

    Single pixels, ground truth and hits are traced on the CPU, by the same caster.
    """

    def __init__(
        self,
        scene: SceneModel,
        camera: CameraModel,
        config: RenderConfig,
        threads: int,
        rgb: bool = False,
        switches: Switches = UNFORCED,
        like: DirectRenderer | None = None,
    ) -> None:
        """Copy the scene to the GPU, and compile the kernel unless it is in the cache.

        Args:
            scene: As of DirectRenderer, without shapes that deform.
            camera: As of DirectRenderer.
            config: As of DirectRenderer.
            threads: As of DirectRenderer, of what the CPU does.
            rgb: False.
            switches: As of DirectRenderer.
            like: As of DirectRenderer.

        Raises:
            EvsError: There is no GPU, or no memory on it.
        """
        gpu = the_gpu()
        super().__init__(scene, camera, config, threads, rgb, switches, like)
        gpu.use()
        self._gpu = gpu
        self._luminance = gpu.pinned(self.shape, np.float32)
        self._layout = layout = _core.DeviceFrame(self._caster)
        self._constant = gpu.allocate(layout.constant_bytes)
        constant = np.empty(layout.constant_bytes, np.uint8)
        layout.copy_constant(self._constant.address, constant)
        gpu.upload(self._constant, constant)
        gpu.wait()
        self._tick = gpu.allocate(layout.tick_bytes)
        self._staged = gpu.pinned((layout.tick_bytes,), np.uint8)
        self._frame = np.zeros(layout.frame_bytes, np.uint8)
        self._first_pass = np.zeros(layout.frame_bytes, np.uint8)
        self._light = gpu.allocate(self._luminance.nbytes)
        self._untextured = gpu.allocate(self._luminance.nbytes if layout.adaptive else 0)
        code = cached_kernel(
            "direct",
            gpu.architecture,
            {"EVS_CHANNELS": self._caster.channels, "EVS_ADAPTIVE": int(layout.adaptive)},
        )
        names = ("first_pass", "second_pass") if layout.adaptive else ("direct",)
        self._kernels = [gpu.kernel(code, name) for name in names]

    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """As of DirectRenderer."""
        gpu, layout = self._gpu, self._layout
        gpu.use()
        layout.copy_tick(
            *self._place(snapshot, pose),
            constant=self._constant.address,
            tick=self._tick.address,
            out=self._staged,
            frame=self._frame,
            first_pass=self._first_pass,
        )
        gpu.upload(self._tick, self._staged)
        height, width = self.shape
        blocks = (width + 7) // 8, (height + 15) // 16
        light, untextured = self._light.argument, self._untextured.argument
        if layout.adaptive:
            first, second = self._kernels
            gpu.launch(first, blocks, THREADS, self._first_pass, light, untextured)
            gpu.launch(second, blocks, THREADS, self._frame, untextured, light)
        else:
            gpu.launch(self._kernels[0], blocks, THREADS, self._frame, light)
        gpu.download(self._luminance, self._light)
        if into is None:
            return self._luminance
        np.copyto(into, self._luminance)
        return into

    def lend(self) -> LentRenderer | str:
        """As of DirectRenderer."""
        return "render.device is cuda"
