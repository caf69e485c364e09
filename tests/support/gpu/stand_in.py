"""A stand-in for a GPU where there is none: this memory, and the portable kernels of the CPU."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import _core


class StandInMemory:
    """Bytes that no kernel has written yet."""

    def __init__(self, size: int) -> None:
        self.bytes = np.full(max(size, 1), 0xCC, np.uint8)
        self.address = self.bytes.ctypes.data

    @property
    def argument(self) -> npt.NDArray[np.uint64]:
        return np.array([self.address], np.uint64)


class StandInGpu:
    """As evs.emulator.render.gpu.driver.Gpu."""

    name = "none"
    architecture = 0

    def __init__(self) -> None:
        self.uploaded = 0
        self._first_pass = np.zeros(0, np.uint8)

    def use(self) -> None:
        pass

    def wait(self) -> None:
        pass

    def allocate(self, size: int) -> StandInMemory:
        return StandInMemory(size)

    def pinned(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        return np.zeros(shape, dtype)

    def upload(self, memory: StandInMemory, source: npt.NDArray[np.uint8]) -> None:
        assert source.nbytes <= memory.bytes.nbytes
        memory.bytes[: source.nbytes] = source
        self.uploaded += source.nbytes

    def download(self, target: npt.NDArray[Any], memory: StandInMemory) -> None:
        ctypes.memmove(target.ctypes.data, memory.address, target.nbytes)

    def kernel(self, code: bytes, name: str) -> str:
        del code
        return name

    def launch(
        self, kernel: str, blocks: Sequence[int], threads: int, *arguments: npt.NDArray[Any]
    ) -> None:
        """The work of `direct`, or of both passes in the second."""
        frame = arguments[0]
        if kernel == "first_pass":
            self._first_pass = frame.copy()
            return
        first = self._first_pass if kernel == "second_pass" else np.zeros_like(frame)
        # width and height, rounded up to blocks, hold the image
        light = (ctypes.c_float * self.pixels).from_address(int(arguments[-1][0]))
        luminance = np.frombuffer(light, np.float32).reshape(self.shape)
        _core.trace_device_frame(frame, first, luminance)

    shape = (0, 0)

    @property
    def pixels(self) -> int:
        return self.shape[0] * self.shape[1]
