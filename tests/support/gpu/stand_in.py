"""A stand-in for a GPU where there is none: this memory, and the portable kernels of the CPU."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from evs.emulator import _core
from evs.emulator.base.gpu import compiler, driver
from evs.emulator.base.gpu.compiler import SCAN_THREADS
from evs.emulator.base.gpu.driver import DevicePart
from evs.emulator.camera import pixel_pipeline
from evs.emulator.evsnet.gpu.network import KERNELS as NETWORK_KERNELS
from evs.emulator.render import device as render_device


def _trace_pass(edges: bool, frame: npt.NDArray[Any], *arguments: npt.NDArray[Any]) -> None:
    """Run a kernel of `hybrid`, whose first argument is a part of all arguments."""
    assert isinstance(frame.base, np.ndarray)
    counts, missing, readers, rooms = arguments[2].tolist()
    light = [int(argument[0]) for argument in arguments[3:]]
    first, untextured, last = light if edges else (0, light[1], light[0])
    lists = counts, missing, rooms & 0xFFFFFFFF, readers, rooms >> 32
    _core.trace_device_pass(frame.base, edges, *lists, first, untextured, last)


def _offer_readers(*arguments: npt.NDArray[Any]) -> None:
    _core.offer_device_readers(*[int(argument[0]) for argument in arguments])


HYBRID_KERNELS = {
    "hybrid": partial(_trace_pass, False),
    "hybrid_at_edges": partial(_trace_pass, True),
    "offer_readers": _offer_readers,
}


class StandInMemory:
    """Bytes that no kernel has written yet."""

    def __init__(self, size: int) -> None:
        self.bytes = np.full(max(size, 1), 0xCC, np.uint8)
        self.address = self.bytes.ctypes.data

    @property
    def argument(self) -> npt.NDArray[np.uint64]:
        return np.array([self.address], np.uint64)


class StandInMark:
    """As evs.emulator.base.gpu.driver.Mark: whatever was launched is done."""

    def move(self) -> None:
        pass

    def wait(self) -> None:
        pass


class StandInGpu:
    """As evs.emulator.base.gpu.driver.Gpu."""

    name = "none"
    architecture = 0

    def __init__(self) -> None:
        self.uploaded = 0
        self.loaded: dict[Any, Any] = {}
        self._arguments = np.zeros(0, np.uint8)
        self._prepared: list[object] = []

    def use(self) -> None:
        pass

    def wait(self) -> None:
        pass

    def mark(self) -> StandInMark:
        return StandInMark()

    def copy(self, target: StandInMemory, source: StandInMemory, size: int) -> None:
        target.bytes[:size] = source.bytes[:size]

    def allocate(self, size: int) -> StandInMemory:
        return StandInMemory(size)

    def pinned(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        return np.zeros(shape, dtype)

    def upload(self, memory: StandInMemory | DevicePart, source: npt.NDArray[Any]) -> None:
        assert isinstance(memory, DevicePart) or source.nbytes <= memory.bytes.nbytes
        ctypes.memmove(memory.address, source.ctypes.data, source.nbytes)
        self.uploaded += source.nbytes

    def download(self, target: npt.NDArray[Any], memory: StandInMemory | DevicePart) -> None:
        ctypes.memmove(target.ctypes.data, memory.address, target.nbytes)

    def load(self, code: bytes) -> object:
        del code
        return object()

    def kernel(self, module: object, name: str) -> str:
        """Its name. Pixels read a table of their module, which `prepare` has to fill before."""
        if name == "prepare":
            self._prepared.append(module)
        assert module in self._prepared or not name.startswith("step_blocks")
        return name

    def launch(
        self, kernel: str, blocks: Sequence[int], threads: int, *arguments: npt.NDArray[Any]
    ) -> None:
        """Run the kernel; of renderers, all the work of a frame in its last one."""
        if kernel in NETWORK_KERNELS:
            _core.launch_network_kernel(kernel, blocks[0], threads, list(arguments))
            return
        if kernel in HYBRID_KERNELS:
            HYBRID_KERNELS[kernel](*arguments)
            return
        if kernel == "step_blocks":
            _core.step_device_pixels(arguments[0])
        if kernel == "step_blocks_of_many":
            for row in _rows(arguments[0], blocks[1], int(arguments[1][0])):
                _core.step_device_pixels(row)
        if kernel == "direct_of_many":
            for row in _rows(arguments[0], blocks[2], int(arguments[1][0])):
                light = _rows(row[-8:].view(np.uint64), 1, 4 * self.shape[0] * self.shape[1])
                _core.trace_device_frame(row[:-8], light.view(np.float32).reshape(self.shape))
        if kernel == "place_crossings":
            assert (blocks[0], threads) == (1, SCAN_THREADS)
            _core.place_device_crossings(*[int(argument[0]) for argument in arguments])
        if kernel == "pack_crossings":
            numbers = [int(argument[0]) for argument in arguments]
            _core.pack_device_crossings(blocks[0] * threads, *numbers)
        if kernel in ("direct", "first_pass", "trace_samples"):
            # the parameter is a part of all arguments, from its own on
            base = arguments[0].base
            assert isinstance(base, np.ndarray)
            self._arguments = base.copy()
        if kernel in ("direct", "second_pass", "add_samples"):
            light = (ctypes.c_float * (self.shape[0] * self.shape[1])).from_address(
                int(arguments[-1][0])
            )
            luminance = np.frombuffer(light, np.float32).reshape(self.shape)
            _core.trace_device_frame(self._arguments, luminance)

    shape = (0, 0)
    """height and width of the image, which a test says"""


def _rows(address: npt.NDArray[Any], rows: int, size: int) -> npt.NDArray[np.uint8]:
    """Memory as (rows, size) uint8."""
    memory = (ctypes.c_uint8 * (rows * size)).from_address(int(address[0]))
    return np.frombuffer(memory, np.uint8).reshape(rows, size)


def stand_in(monkeypatch: pytest.MonkeyPatch, *modules: ModuleType) -> StandInGpu | None:
    """Let a stand-in take the place of the GPU in modules; None: there is a GPU, and it stays."""
    if not driver.why_no_gpu():
        return None
    gpu = StandInGpu()
    for module in modules:
        monkeypatch.setattr(module, "the_gpu", lambda: gpu)
    monkeypatch.setattr(compiler, "cached_kernel", lambda *told: b"")
    for chooses in (render_device, pixel_pipeline):
        monkeypatch.setattr(chooses, "why_no_gpu", lambda: "")
    return gpu
