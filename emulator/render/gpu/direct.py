"""The `direct` renderer on a GPU: the kernel of the native core, a pixel a thread."""

from __future__ import annotations

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.gpu.compiler import kernels_of
from evs.emulator.base.gpu.driver import the_gpu
from evs.emulator.base.scene import F32, CameraModel, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.config import RenderConfig
from evs.emulator.render.direct import DirectRenderer, LentRenderer
from evs.emulator.render.gpu.renderer import CudaRenderer
from evs.emulator.render.gpu.scene import UploadedScene


class CudaDirectRenderer(CudaRenderer):
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
        self._there = UploadedScene(gpu, self._caster, self.shape)
        adaptive, channels = self._there.adaptive, self._caster.channels
        self._untextured = self._there.room(self._luminance.nbytes if adaptive else 0)
        names = ("first_pass", "second_pass") if adaptive else ("direct",)
        macros = {"EVS_CHANNELS": channels, "EVS_ADAPTIVE": int(adaptive)}
        self._kernels = kernels_of(gpu, "render/direct", names, macros)

    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """As of DirectRenderer."""
        there = self._there
        there.upload(self._place(snapshot, pose))
        light = there.target(into)
        if there.adaptive:
            first, second = self._kernels
            untextured = self._untextured.argument
            there.launch(first, there.first_pass, light, untextured)
            there.launch(second, there.frame, untextured, light)
        else:
            there.launch(self._kernels[0], there.frame, light)
        return there.download(into)

    def lend(self) -> LentRenderer | str:
        """As of DirectRenderer."""
        if self._there.adaptive:
            return "a GPU renders samples at edges camera by camera"
        parts = super().lend()
        if isinstance(parts, str):
            return parts
        return parts._replace(luminance=self._there.luminance, device=self._there)
