"""A GPU through CUDA's driver: memory, kernels and times, as measure.py needs them."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from cuda.bindings import driver


def checked(result: tuple[Any, ...]) -> Any:
    """What a call of the driver returns besides its error.

    Raises:
        RuntimeError: The call failed.
    """
    if result[0] != driver.CUresult.CUDA_SUCCESS:
        raise RuntimeError(str(result[0]))
    return result[1] if len(result) == 2 else result[1:]


class Gpu:
    """The first GPU of this machine."""

    def __init__(self) -> None:
        checked(driver.cuInit(0))
        self.device = checked(driver.cuDeviceGet(0))
        context = checked(driver.cuDevicePrimaryCtxRetain(self.device))
        checked(driver.cuCtxSetCurrent(context))
        self.events = [checked(driver.cuEventCreate(0)) for _ in range(2)]
        self.stream = checked(driver.cuStreamCreate(0))

    def name(self) -> str:
        return checked(driver.cuDeviceGetName(64, self.device)).rstrip(b"\0").decode()

    def attribute(self, which: str) -> int:
        of = driver.CUdevice_attribute
        value: int = checked(
            driver.cuDeviceGetAttribute(getattr(of, f"CU_DEVICE_ATTRIBUTE_{which}"), self.device)
        )
        return value

    def allocate(self, size: int) -> int:
        """The address of so many bytes; every byte is 0xcc."""
        address = int(checked(driver.cuMemAlloc(size)))
        self.overwrite(address, size)
        return address

    def overwrite(self, address: int, size: int) -> None:
        """Fill memory with bytes that are no result."""
        checked(driver.cuMemsetD8(address, 0xCC, size))

    def free(self, address: int) -> None:
        checked(driver.cuMemFree(address))

    def upload(self, address: int, source: int, size: int) -> None:
        checked(driver.cuMemcpyHtoDAsync(address, source, size, self.stream))

    def download(self, target: np.ndarray, address: int) -> None:
        """Copy to an array, and wait for it."""
        checked(driver.cuMemcpyDtoHAsync(target.ctypes.data, address, target.nbytes, self.stream))
        self.wait()

    def pinned(self, count: int, dtype: type) -> np.ndarray:
        """An array in memory that a GPU copies from and to at full speed."""
        size = count * np.dtype(dtype).itemsize
        address = checked(driver.cuMemAllocHost(size))
        memory = (ctypes.c_char * size).from_address(int(address))
        return np.frombuffer(memory, dtype=dtype, count=count)

    def new_stream(self) -> Any:
        return checked(driver.cuStreamCreate(1))

    def wait_for_all(self) -> None:
        checked(driver.cuCtxSynchronize())

    def wait(self) -> None:
        checked(driver.cuStreamSynchronize(self.stream))

    def milliseconds(self, work: Callable[[], None], repeats: int) -> np.ndarray:
        """How long the GPU takes for work, repeated; after two more, which do not count."""
        took = []
        for turn in range(repeats + 2):
            checked(driver.cuEventRecord(self.events[0], self.stream))
            work()
            checked(driver.cuEventRecord(self.events[1], self.stream))
            checked(driver.cuEventSynchronize(self.events[1]))
            if turn >= 2:
                took.append(checked(driver.cuEventElapsedTime(*self.events)))
        return np.array(took)


class Kernel:
    """A kernel of a file of machine code."""

    def __init__(self, gpu: Gpu, code: Path, name: str) -> None:
        self.gpu = gpu
        self.code = code.read_bytes()
        module = checked(driver.cuModuleLoadData(self.code))
        self.function = checked(driver.cuModuleGetFunction(module, name.encode()))

    def attribute(self, which: str) -> int:
        of = driver.CUfunction_attribute
        value: int = checked(
            driver.cuFuncGetAttribute(getattr(of, f"CU_FUNC_ATTRIBUTE_{which}"), self.function)
        )
        return value

    def describe(self, threads: int) -> str:
        """Registers, memory of a thread, and how full blocks of `threads` make a multiprocessor."""
        blocks = checked(
            driver.cuOccupancyMaxActiveBlocksPerMultiprocessor(self.function, threads, 0)
        )
        warps = blocks * threads // 32
        most = self.gpu.attribute("MAX_THREADS_PER_MULTIPROCESSOR") // 32
        return (
            f"{self.attribute('NUM_REGS')} registers, {self.attribute('LOCAL_SIZE_BYTES')} B of "
            f"local memory a thread, {warps} of {most} warps a multiprocessor"
        )

    def __call__(
        self, blocks: Sequence[int], threads: int, *arguments: np.ndarray, stream: Any = None
    ) -> None:
        """Launch it. Each argument is an array that holds the bytes of one parameter."""
        pointers = np.array([argument.ctypes.data for argument in arguments], dtype=np.uint64)
        x, y = (*blocks, 1)[:2]
        queue = stream or self.gpu.stream
        checked(
            driver.cuLaunchKernel(
                self.function, x, y, 1, threads, 1, 1, 0, queue, pointers.ctypes.data, 0
            )
        )
