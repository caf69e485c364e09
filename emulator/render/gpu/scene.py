"""A scene on a GPU: what stays there, what a tick replaces, and the kernels' arguments."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
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
            caster: Of direct or path, as DeviceFrame takes it.
            shape: Height and width of the image, px.

        Raises:
            EvsError: The GPU has no more memory.
        """
        gpu.use()
        self._gpu = gpu
        self._layout = layout = _core.DeviceFrame(caster)
        self.adaptive = layout.adaptive
        """whether there is a first pass of adaptive antialiasing"""
        self._constant = gpu.allocate(layout.constant_bytes)
        constant = np.empty(layout.constant_bytes, np.uint8)
        layout.copy_constant(self._constant.address, constant)
        gpu.upload(self._constant, constant)
        gpu.wait()
        self._tick = gpu.allocate(layout.tick_bytes)
        self._staged = gpu.pinned((layout.tick_bytes,), np.uint8)
        self._arguments = np.zeros(layout.argument_bytes, np.uint8)
        starts = layout.argument_offsets
        self.frame, self.first_pass, self.paths = (self._arguments[at:] for at in starts)
        """(bytes,) uint8, arguments of kernels"""
        height, width = shape
        self.blocks = (width + 7) // 8, (height + 15) // 16
        """how many of THREADS hold the image, along x and y"""
        self.luminance = gpu.pinned(shape, np.float32)
        """(h, w) the light of the last `download`"""
        self.light = gpu.allocate(self.luminance.nbytes)
        """the same on the GPU"""

    def upload(self, placed: tuple[F64, F64, F64, F64, F64, F64], seed: int = 0) -> None:
        """Place everything for a tick, and upload what it changes.

        Args:
            placed: Poses, as Caster.render takes them.
            seed: Of the tick's noise.
        """
        self._gpu.use()
        self._layout.copy_tick(
            *placed,
            constant=self._constant.address,
            tick=self._tick.address,
            out=self._staged,
            arguments=self._arguments,
            seed=seed,
        )
        self._gpu.upload(self._tick, self._staged)

    def download(self, into: F32 | None) -> F32:
        """Wait for the light.

        Args:
            into: (h, w) float32, where it goes; None: `luminance`.

        Returns:
            (h, w) float32.
        """
        self._gpu.download(self.luminance, self.light)
        if into is None:
            return self.luminance
        np.copyto(into, self.luminance)
        return into

    def launch(self, kernel: object, *arguments: npt.NDArray[np.generic], deep: int = 1) -> None:
        """Launch a kernel over the image, so many threads deep."""
        self._gpu.launch(kernel, (*self.blocks, deep), THREADS, *arguments)

    def room(self, size: int) -> DeviceMemory:
        """So many bytes on the GPU."""
        return self._gpu.allocate(size)
