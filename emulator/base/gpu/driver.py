"""The first NVIDIA GPU of this machine: memory, kernels, launches; and the compiler for it.

The door to cuda.bindings: CUDA's driver and NVRTC, which needs neither a GPU nor a driver.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from evs.msgs import EvsError

INSTALL = "pip install 'evs[cuda]'"

DEVICES = ("cpu", "cuda", "auto")
"""where what a key `device` names may run; auto: on a GPU where that can be"""


_process: list[int] = []
"""that has started CUDA"""


def why_no_gpu() -> str:
    """Why nothing can be rendered on a GPU here, as a reason; "": it can."""
    reason = _why_no_gpu()
    if not reason and _process[0] != os.getpid():
        return "CUDA was started before this process was forked: start processes with spawn"
    return reason


@cache
def _why_no_gpu() -> str:
    try:
        from cuda.bindings import driver
    except ImportError:
        return f"the extra cuda is not installed: {INSTALL}"
    _process.append(os.getpid())
    try:
        (error,) = driver.cuInit(0)
    except RuntimeError:
        return "this machine has no NVIDIA driver"
    if error != driver.CUresult.CUDA_SUCCESS:
        return f"there is no NVIDIA GPU ({error.name})"
    try:
        compiler()
        _gpu()
    except EvsError as reason:
        return str(reason)
    return ""


def the_gpu() -> Gpu:
    """The first GPU, initialised once.

    Raises:
        EvsError: There is none, or the extra is not installed.
    """
    if reason := why_no_gpu():
        raise EvsError(f"nothing can be rendered on a GPU: {reason}")
    return _gpu()


@cache
def _gpu() -> Gpu:
    return Gpu()


def compiler() -> Any:
    """NVRTC, as cuda.bindings.nvrtc.

    Raises:
        EvsError: It is not installed.
    """
    try:
        from cuda.bindings import nvrtc

        nvrtc.nvrtcVersion()
    except (ImportError, RuntimeError):
        raise EvsError(f"the compiler for GPUs is not installed: {INSTALL}") from None
    return nvrtc


class Gpu:
    """A GPU with one stream of work."""

    def __init__(self) -> None:
        """Take the first one. `why_no_gpu` has found it."""
        from cuda.bindings import driver

        self._driver = driver
        of = driver.CUdevice_attribute
        device = self.checked(driver.cuDeviceGet(0))
        self._context = self.checked(driver.cuDevicePrimaryCtxRetain(device))
        self.use()
        self._stream = self.checked(driver.cuStreamCreate(0))

        def attribute(which: Any) -> int:
            return int(self.checked(driver.cuDeviceGetAttribute(which, device)))

        self.name = self.checked(driver.cuDeviceGetName(256, device)).split(b"\0")[0].decode()
        """what its maker calls it"""
        self.architecture = 10 * attribute(
            of.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR
        ) + attribute(of.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR)
        """its compute capability, such as 90 for 9.0"""
        self.loaded: dict[Any, Any] = {}
        """modules by what they were compiled from"""

    def checked(self, result: tuple[Any, ...]) -> Any:
        """What a call of the driver returns besides its error.

        Raises:
            EvsError: The call failed.
        """
        if result[0] != self._driver.CUresult.CUDA_SUCCESS:
            raise EvsError(f"the GPU failed: {result[0].name}; device=cpu needs none")
        return result[1] if len(result) == 2 else None

    def use(self) -> None:
        """Let this thread of Python use it."""
        self.checked(self._driver.cuCtxSetCurrent(self._context))

    def free(self, call: Any, address: Any) -> None:
        """Free memory in any thread. What fails here has been freed with the process."""
        self._driver.cuCtxSetCurrent(self._context)
        call(address)

    def allocate(self, size: int) -> DeviceMemory:
        """So many bytes on it. Raises EvsError where it has no more."""
        return DeviceMemory(self, size)

    def pinned(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """An array of zeros that it copies from and to at full speed."""
        return np.asarray(_PinnedMemory(self, shape, np.dtype(dtype)))

    def upload(self, memory: DeviceMemory | DevicePart, source: npt.NDArray[Any]) -> None:
        """Copy an array there, after all that was launched.

        Args:
            memory: Where to, from its first byte on.
            source: It must not change before the copy is done.
        """
        self.checked(
            self._driver.cuMemcpyHtoDAsync(
                memory.address, source.ctypes.data, source.nbytes, self._stream
            )
        )

    def copy(self, target: DeviceMemory, source: DeviceMemory, size: int) -> None:
        """Copy `size` bytes on it."""
        self.checked(
            self._driver.cuMemcpyDtoDAsync(target.address, source.address, size, self._stream)
        )

    def mark(self) -> Mark:
        """What can be waited for: all that was launched so far."""
        return Mark(self)

    def download(self, target: npt.NDArray[Any], memory: DeviceMemory | DevicePart) -> None:
        """Copy to an array, and wait for it."""
        self.checked(
            self._driver.cuMemcpyDtoHAsync(
                target.ctypes.data, memory.address, target.nbytes, self._stream
            )
        )
        self.wait()

    def wait(self) -> None:
        """Wait for all that was launched."""
        self.checked(self._driver.cuStreamSynchronize(self._stream))

    def load(self, code: bytes) -> Any:
        """A module of machine code; it stays loaded."""
        return self.checked(self._driver.cuModuleLoadData(code))

    def kernel(self, module: Any, name: str) -> Any:
        """A kernel of a module, for `launch`."""
        return self.checked(self._driver.cuModuleGetFunction(module, name.encode()))

    def launch(
        self, kernel: Any, blocks: Sequence[int], threads: int, *arguments: npt.NDArray[Any]
    ) -> None:
        """Launch a kernel.

        Args:
            kernel: Of `kernel`.
            blocks: How many along x, y and z.
            threads: Of a block.
            arguments: An array with the bytes of each parameter.
        """
        pointers = np.array([argument.ctypes.data for argument in arguments], np.uint64)
        x, y, z = blocks
        self.checked(
            self._driver.cuLaunchKernel(
                kernel, x, y, z, threads, 1, 1, 0, self._stream, pointers.ctypes.data, 0
            )
        )


class Mark:
    """A place among what is launched on a GPU."""

    def __init__(self, gpu: Gpu) -> None:
        """Behind all that was launched so far."""
        self._gpu = gpu
        # without a clock
        self._event = gpu.checked(gpu._driver.cuEventCreate(2))
        gpu.checked(gpu._driver.cuEventRecord(self._event, gpu._stream))

    def move(self) -> None:
        """Behind all that was launched so far."""
        self._gpu.checked(self._gpu._driver.cuEventRecord(self._event, self._gpu._stream))

    def wait(self) -> None:
        """Wait until the GPU has passed it."""
        self._gpu.checked(self._gpu._driver.cuEventSynchronize(self._event))

    def __del__(self) -> None:
        if hasattr(self, "_event"):
            self._gpu.free(self._gpu._driver.cuEventDestroy, self._event)


class DeviceMemory:
    """Bytes on a GPU, freed with this object."""

    def __init__(self, gpu: Gpu, size: int) -> None:
        """Allocate. Raises EvsError where there is no more."""
        self._gpu = gpu
        self.address = int(gpu.checked(gpu._driver.cuMemAlloc(max(size, 1))))

    @property
    def argument(self) -> npt.NDArray[np.uint64]:
        """As a parameter of a kernel."""
        return np.array([self.address], np.uint64)

    def __del__(self) -> None:
        if hasattr(self, "address"):
            self._gpu.free(self._gpu._driver.cuMemFree, self.address)


class DevicePart(NamedTuple):
    """A part of the memory on a GPU, owned by another array."""

    address: int


class _PinnedMemory:
    """What an array of `Gpu.pinned` lies in, freed with the array."""

    def __init__(self, gpu: Gpu, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        self._gpu = gpu
        size = max(int(np.prod(shape)) * dtype.itemsize, 1)
        self._address = int(gpu.checked(gpu._driver.cuMemAllocHost(size)))
        self.__array_interface__ = {
            "shape": shape,
            "typestr": dtype.str,
            "data": (self._address, False),
            "version": 3,
        }
        np.asarray(self).fill(0)

    def __del__(self) -> None:
        if hasattr(self, "_address"):
            self._gpu.free(self._gpu._driver.cuMemFreeHost, self._address)
