"""A scene on a GPU: what stays there, what a tick replaces, and the kernels' arguments."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.gpu.arrays import DeviceLight
from evs.emulator.base.gpu.driver import DeviceMemory, Gpu
from evs.emulator.base.scene import F32, F64

THREADS = 128
"""of a block: 8 x 16 pixels"""


class UploadedScene:
    """What the kernels of one caster read, and the light that they write."""

    def __init__(self, gpu: Gpu, caster: _core.Caster, shape: tuple[int, int]) -> None:
        """Copy what stays to the GPU.

        Args:
            gpu: Where to.
            caster: As DeviceFrame takes it.
            shape: Height and width of the image, px.

        Raises:
            EvsError: The GPU has no more memory.
        """
        gpu.use()
        self._gpu = gpu
        self.layout = layout = _core.DeviceFrame(caster)
        """of what is copied"""
        self.channels = caster.channels
        """of the light that is traced"""
        self.adaptive = layout.adaptive
        """whether there is a first pass of adaptive antialiasing"""
        self.constant = gpu.allocate(layout.constant_bytes)
        """what stays"""
        constant = np.empty(layout.constant_bytes, np.uint8)
        layout.copy_constant(self.constant.address, constant)
        gpu.upload(self.constant, constant)
        gpu.wait()
        self._tick = gpu.allocate(layout.tick_bytes)
        self._staged = gpu.pinned((layout.tick_bytes,), np.uint8)
        self._uploaded = gpu.mark()
        self.arguments = np.zeros(layout.argument_bytes, np.uint8)
        """(argument_bytes,) uint8, of all kernels"""
        parts = [self.arguments[at:] for at in layout.argument_offsets]
        self.frame, self.first_pass, self.paths, self.cache = parts
        """(bytes,) uint8, arguments of a kernel"""
        self._shape = height, width = shape
        self.blocks = (width + 7) // 8, (height + 15) // 16
        """how many of THREADS hold the image, along x and y"""
        self.luminance = gpu.pinned(shape, np.float32)
        """(h, w) the light of the last `download`"""
        self.light = gpu.allocate(self.luminance.nbytes)
        """the same on the GPU"""

    def upload(self, placed: tuple[F64, F64, F64, F64, F64, F64], seed: int = 0) -> str:
        """Place everything for a tick, and upload what it changes.

        Args:
            placed: Poses, as Caster.render takes them.
            seed: Of the tick's noise.

        Returns:
            Where its pixels are to be traced, as in DeviceFrame.copy_tick.
        """
        self._gpu.use()
        # what was staged before may be on its way
        self._uploaded.wait()
        where: str = self.layout.copy_tick(
            *placed,
            constant=self.constant.address,
            tick=self._tick.address,
            out=self._staged,
            arguments=self.arguments,
            seed=seed,
        )
        self._gpu.upload(self._tick, self._staged)
        self._uploaded.move()
        return where

    def device_light(self) -> DeviceLight:
        """Other memory for light on the GPU."""
        return DeviceLight(self._gpu, self._shape)

    def target(self, into: object) -> npt.NDArray[np.uint64]:
        """Where the kernels write the light, as a parameter of theirs.

        Args:
            into: See `download`.
        """
        memory = into.memory if isinstance(into, DeviceLight) else self.light
        return memory.argument

    def download(self, into: F32 | None) -> F32:
        """Wait for the light, unless it stays on the GPU.

        Args:
            into: (h, w) float32, where it goes; a DeviceLight, where it is already; None:
                `luminance`.

        Returns:
            (h, w) float32, `into` where that is given.
        """
        if isinstance(into, DeviceLight):
            into.changed()
            return into  # NumPy takes it as an array
        self._gpu.download(self.luminance, self.light)
        if into is None:
            return self.luminance
        np.copyto(into, self.luminance)
        return into

    def put_light(self) -> None:
        """Upload `luminance` as the light."""
        self._gpu.use()
        self._gpu.upload(self.light, self.luminance)
        self._gpu.wait()

    def copy_light(self, into: DeviceLight) -> None:
        """Copy the light to other memory there."""
        self._gpu.copy(into.memory, self.light, self.luminance.nbytes)
        into.changed()

    def launch(self, kernel: object, *arguments: npt.NDArray[np.generic], deep: int = 1) -> None:
        """Launch a kernel over the image, so many threads deep."""
        self._gpu.launch(kernel, (*self.blocks, deep), THREADS, *arguments)

    def room(self, size: int) -> DeviceMemory:
        """So many bytes on the GPU."""
        return self._gpu.allocate(size)


class GpuDevice:
    """A GPU traces all pixels in every tick. It is a Device of evs.emulator.render.device."""

    uploaded: object = None
    why_not_lent: str

    def __init__(self, gpu: Gpu, caster: _core.Caster, shape: tuple[int, int]) -> None:
        """Copy the scene to the GPU.

        Those of the integrators take `samples` (per pixel) and `shared` (the device of the same
        camera's renderer until now, or None) as well.

        Args:
            gpu: Where to.
            caster: What the CPU traces with.
            shape: Height and width of the image, px.

        Raises:
            EvsError: There is no memory on it.
        """
        self._scene = UploadedScene(gpu, caster, shape)
        self.luminance = self._scene.luminance

    def device_light(self) -> DeviceLight:
        """See DeviceRenderer."""
        return self._scene.device_light()

    def fetch(self) -> None:
        """See Device: `render` downloads it."""

    def replace_light(self) -> None:
        """See Device: no tick reads the last one's light."""
