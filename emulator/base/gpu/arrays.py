"""Arrays that lie on a GPU: the light of a camera, and the state of what runs there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.gpu.driver import DeviceMemory, Gpu
from evs.emulator.base.scene import F32

ALIGNMENT = 256
"""of an array among others, bytes"""


class DeviceLight:
    """The light of one instant on a GPU; NumPy's functions take it as an array.

    It is downloaded where somebody reads it, once.
    """

    dtype = np.dtype(np.float32)

    def __init__(self, gpu: Gpu, shape: tuple[int, int]) -> None:
        """Allocate it.

        Args:
            gpu: Where it lies.
            shape: Height and width, px.

        Raises:
            EvsError: The GPU has no more memory.
        """
        self._gpu, self.shape = gpu, shape
        self.nbytes = 4 * shape[0] * shape[1]
        self.memory = gpu.allocate(self.nbytes)
        """(h, w) float32, linear luminance"""
        self._here: F32 | None = None
        self._is_here = False

    def changed(self) -> None:
        """Kernels that write it have been launched."""
        self._is_here = False

    def put(self, light: F32) -> None:
        """Upload light; (h, w) float32."""
        self._gpu.use()
        np.copyto(self._pinned(), light)
        self._gpu.upload(self.memory, self._pinned())
        self._is_here = True

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> F32:
        """(h, w) float32, its light; without a copy the array is valid until the next one."""
        here = self._pinned()
        if not self._is_here:
            self._gpu.use()
            self._gpu.download(here, self.memory)
            self._is_here = True
        return np.array(here, dtype) if copy or dtype not in (None, here.dtype) else here

    def _pinned(self) -> F32:
        if self._here is None:
            self._here = self._gpu.pinned(self.shape, np.float32)
        return self._here


def power_from(count: int) -> int:
    """The least power of 2 that is at least that: how much room is made for so many."""
    return 1 << max(count - 1, 0).bit_length()


def layout_of(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[dict[str, int], int]:
    """Where each of some arrays lies, one after another, and how many bytes there are."""
    offsets: dict[str, int] = {}
    size = 0
    for name, array in arrays.items():
        offsets[name] = size
        size += -(-array.nbytes // ALIGNMENT) * ALIGNMENT
    return offsets, size


def take_from_device(array: npt.NDArray[Any], data: npt.NDArray[np.uint8]) -> None:
    """Fill an array with bytes that were downloaded.

    A GPU gives each NaN that it computes other bits than a CPU does: they become those of a CPU.
    """
    array.reshape(-1).view(np.uint8)[:] = data
    if array.dtype.kind == "f":
        array[np.isnan(array)] = np.nan


class DeviceArrays:
    """Arrays of a state, here and on a GPU, one after another in one block of memory."""

    def __init__(self, gpu: Gpu, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Allocate them, and upload.

        Args:
            gpu: Where they lie.
            arrays: Contiguous, by name; `fetch` writes to them.

        Raises:
            EvsError: The GPU has no more memory.
        """
        self._gpu, self._arrays = gpu, dict(arrays)
        self._offsets, size = layout_of(self._arrays)
        gpu.use()
        self._here = gpu.pinned((size,), np.uint8)
        self._there = gpu.allocate(size)
        self._kept: DeviceMemory | None = None
        self._is_here = True
        self.push()

    @property
    def addresses(self) -> dict[str, int]:
        """Where each lies on the GPU."""
        return {name: self._there.address + at for name, at in self._offsets.items()}

    def changed(self) -> None:
        """Kernels that write to them have been launched."""
        self._is_here = False

    def push(self) -> None:
        """Upload all of them."""
        self._gpu.use()
        for name, array in self._arrays.items():
            self._bytes_of(name)[:] = array.reshape(-1).view(np.uint8)
        self._gpu.upload(self._there, self._here)
        self._gpu.wait()
        self._is_here = True

    def fetch(self) -> None:
        """Download all of them, unless they have not changed there."""
        if self._is_here:
            return
        self._gpu.use()
        self._gpu.download(self._here, self._there)
        for name, array in self._arrays.items():
            take_from_device(array, self._bytes_of(name))
        self._is_here = True

    def keep(self) -> None:
        """Keep what they are now, on the GPU, for `put_back`."""
        if self._kept is None:
            self._kept = self._gpu.allocate(self._here.nbytes)
        self._gpu.copy(self._kept, self._there, self._here.nbytes)

    def put_back(self) -> None:
        """Make them what they were at the last `keep`."""
        assert self._kept is not None
        self._gpu.copy(self._there, self._kept, self._here.nbytes)

    def _bytes_of(self, name: str) -> npt.NDArray[np.uint8]:
        at = self._offsets[name]
        return self._here[at : at + self._arrays[name].nbytes]
