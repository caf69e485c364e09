"""DeviceBatch: the cameras of many worlds on a GPU, many of them in one launch of each kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.gpu.arrays import ALIGNMENT, layout_of, take_from_device
from evs.emulator.base.gpu.compiler import kernels_of
from evs.emulator.base.gpu.driver import DevicePart, the_gpu
from evs.emulator.base.scene import F64, I32
from evs.emulator.camera.camera import LentCamera
from evs.emulator.render.gpu.scene import THREADS as IMAGE_THREADS
from evs.emulator.render.gpu.scene import UploadedScene
from evs.emulator.sensor.gpu.pixel import (
    THREADS,
    CudaPlainModel,
    CudaPlainState,
    PixelScratch,
    most_state_bytes,
    pixel_kernels,
)
from evs.emulator.sensor.pixel import BLOCK

AT_ONCE = 256
"""cameras that are placed in one go, while the GPU renders those before them"""

Poses = tuple[F64, F64, F64, F64, F64, F64]
"""as `_core.CameraBatch.step` takes them"""


class DeviceBatch:
    """Renders and steps cameras of a `_core.CameraBatch` on a GPU, with the bytes of one by one."""

    def __init__(self, native: _core.CameraBatch, cameras: int) -> None:
        """Set up; no camera is there yet.

        Args:
            native: The batch; it places everything, and keeps the events.
            cameras: How many it has.

        Raises:
            EvsError: There is no GPU.
        """
        self._native, self._cameras, self._gpu = native, cameras, the_gpu()
        self._lent: dict[int, LentCamera] = {}
        self._terms: dict[str, int] = {}
        """macros of the kernels of pixels"""
        self._renders: dict[int, Any] = {}
        """kernels of light by channels"""
        self._stride = 0
        """bytes of the state of a camera"""
        self._row_bytes = (0, 0)
        """of what a tick of a camera changes, and of its frame and where its light goes"""
        self._is_kept = False
        """whether `_kept` has all states as they are"""

    def put(self, camera: int, lent: LentCamera) -> None:
        """Take a camera in, after `put` of the native batch.

        Args:
            camera: Its number.
            lent: Its renderer and pixels, which are on the GPU.

        Raises:
            EvsError: The GPU has no more memory.
        """
        scene, model, state = _parts(lent)
        self._gpu.use()
        if not self._stride:
            self._allocate(scene, model)
        if scene.channels not in self._renders:
            macros = {"EVS_CHANNELS": scene.channels, "EVS_ADAPTIVE": 0, "EVS_MANY": 1}
            (kernel,) = kernels_of(self._gpu, "render/direct", ("direct_of_many",), macros)
            self._renders[scene.channels] = kernel
        self._lent[camera] = lent
        self._make_room(scene)
        arrays = state.fetched().arrays()
        offsets, _ = layout_of(arrays)
        for name, array in arrays.items():
            at = offsets[name]
            self._state[at : at + array.nbytes] = array.reshape(-1).view(np.uint8)
        slot = self._slot(camera)
        self._gpu.upload(slot, self._state)
        self._gpu.wait()
        self._is_kept = False
        pattern = model.pattern_on_device(state.numbers.seed)
        self._native.put_on_device(
            camera,
            scene.layout,
            scene.constant.address,
            pattern.layout,
            pattern.constant.address,
            {name: slot.address + at for name, at in offsets.items()},
        )
        # kernels are for the terms of all cameras
        for name, value in model.kernel_terms.items():
            before = self._terms.setdefault(name, value)
            any_of_them = -1 if name in ("EVS_LOG", "EVS_FILTER") else 1
            self._terms[name] = value if value == before else any_of_them

    def settle(self, camera: int, stepped: bool) -> None:
        """Put a camera back into its renderer and pixels.

        Args:
            camera: Its number.
            stepped: Whether it was stepped since `put`.
        """
        lent = self._lent.pop(camera)
        if not stepped:
            return
        scene, _, state = _parts(lent)
        self._gpu.use()
        self._gpu.download(self._state, self._slot(camera))
        arrays = state.numbers.arrays()
        offsets, _ = layout_of(arrays)
        for name, array in arrays.items():
            at = offsets[name]
            take_from_device(array, self._state[at : at + array.nbytes])
        state.there.push()
        light = DevicePart(self._light.address + camera * scene.luminance.nbytes)
        self._gpu.download(scene.luminance, light)

    def step(
        self, which: I32, poses: Poses, t_begin_us: npt.NDArray[np.int64], tick_us: int
    ) -> None:
        """Render a tick of some cameras and step their pixels.

        Args:
            which: See `_core.CameraBatch.step`.
            poses: As there, by world and by camera.
            t_begin_us: As there.
            tick_us: As there.

        Raises:
            EvsError: More events than memory.
        """
        gpu, count, scratch = self._gpu, len(which), self._scratch
        gpu.use()
        step, place, pack = pixel_kernels(gpu, self._terms, many=True)
        blocks, every_state = count * self._blocks, self._cameras * self._stride
        if not self._is_kept:
            gpu.copy(self._kept, self._states, every_state)
        self._is_kept = False
        self._lay_out(which, poses, tick_us, render=True)
        self._step_pixels(step, count)
        found = scratch.pack(place, pack, blocks)
        while scratch.is_short(found):
            # again, with room for what a block needs
            gpu.copy(self._states, self._kept, every_state)
            scratch.make_blocks(found)
            self._lay_out(which, poses, tick_us, render=False)
            self._step_pixels(step, count)
            found = scratch.pack(place, pack, blocks)
        if found.crossings > scratch.room:
            scratch.make_room(found.crossings)
            found = scratch.pack(place, pack, blocks)
        begins = np.append(scratch.offsets_of(blocks)[:: self._blocks], np.uint32(found.crossings))
        clamped = np.zeros(count, np.int64)
        if found.clamped:
            clamped = scratch.clamped_of(blocks).reshape(count, -1).sum(1, dtype=np.int64)
        crossings = scratch.packed(found.crossings)
        # those of the next tick, while the CPU goes on
        gpu.copy(self._kept, self._states, every_state)
        self._is_kept = True
        self._native.take_tick(which, crossings, begins, clamped, t_begin_us, tick_us)

    def _lay_out(self, which: I32, poses: Poses, tick_us: int, *, render: bool) -> None:
        """Place everything, and upload what the kernels read; launch those of light if `render`."""
        gpu, scratch, here = self._gpu, self._scratch, self._frames_here
        tick_bytes, frame_bytes = self._row_bytes
        stride = np.array([frame_bytes], np.uint32)
        for number, begin in enumerate(range(0, len(which), AT_ONCE)):
            part = which[begin : begin + AT_ONCE]
            at = number * self._part_bytes
            frames_at = at + len(part) * tick_bytes
            end = frames_at + len(part) * frame_bytes
            self._native.lay_out(
                part,
                poses,
                tick_us,
                first=begin,
                tick=self._frames.address + at,
                luminance=self._light.address,
                room=scratch.block_room,
                staged=here[at:frames_at].reshape(-1, tick_bytes),
                frames=here[frames_at:end].reshape(-1, frame_bytes),
                pixels=self._pixels_here[begin : begin + len(part)],
            )
            if render:
                gpu.upload(DevicePart(self._frames.address + at), here[at:end])
                frames = np.array([self._frames.address + frames_at], np.uint64)
                for kernel in self._renders.values():
                    gpu.launch(kernel, (*self._grid, len(part)), IMAGE_THREADS, frames, stride)
        gpu.upload(self._pixels, self._pixels_here[: len(which)])

    def _step_pixels(self, kernel: object, count: int) -> None:
        """Launch the kernel that steps the pixels of so many cameras."""
        grid = (-(-self._blocks // THREADS), count, 1)
        stride = np.array([self._pixels_here.shape[1]], np.uint32)
        self._gpu.launch(kernel, grid, THREADS, self._pixels.argument, stride)

    def _slot(self, camera: int) -> DevicePart:
        """Where the state of a camera lies."""
        return DevicePart(self._states.address + camera * self._stride)

    def _allocate(self, scene: UploadedScene, model: CudaPlainModel) -> None:
        """Memory for all cameras, which are like the first one."""
        gpu, cameras = self._gpu, self._cameras
        height, width = scene.luminance.shape
        self._blocks = -(-height * width // BLOCK)
        self._stride = most_state_bytes(height * width)
        self._state = gpu.pinned((self._stride,), np.uint8)
        self._states = gpu.allocate(cameras * self._stride)
        self._kept = gpu.allocate(cameras * self._stride)
        self._light = gpu.allocate(cameras * scene.luminance.nbytes)
        self._scratch = PixelScratch(gpu, cameras * self._blocks)
        self._grid = scene.blocks
        pixel_bytes = model.pattern_on_device(0).layout.argument_bytes
        self._pixels_here = gpu.pinned((cameras, pixel_bytes), np.uint8)
        self._pixels = gpu.allocate(cameras * pixel_bytes)

    def _make_room(self, scene: UploadedScene) -> None:
        """Make room for what a tick of each camera changes and for its frame, part after part."""
        if scene.layout.tick_bytes > self._row_bytes[0]:
            tick_bytes = _aligned(scene.layout.tick_bytes)
            self._row_bytes = tick_bytes, scene.layout.argument_bytes + 8
            self._part_bytes = _aligned(AT_ONCE * sum(self._row_bytes))
            size = -(-self._cameras // AT_ONCE) * self._part_bytes
            self._frames_here = self._gpu.pinned((size,), np.uint8)
            self._frames = self._gpu.allocate(size)


def _aligned(size: int) -> int:
    return -(-size // ALIGNMENT) * ALIGNMENT


def fit_together(one: LentCamera, other: LentCamera) -> bool:
    """Whether two cameras may be in one batch; those on the CPU may."""
    if one.renderer.device is None and other.renderer.device is None:
        return True
    if one.renderer.device is None or other.renderer.device is None:
        return False
    ours, theirs = _parts(one)[0], _parts(other)[0]
    return ours.luminance.shape == theirs.luminance.shape


def _parts(lent: LentCamera) -> tuple[UploadedScene, CudaPlainModel, CudaPlainState]:
    """What a camera has on the GPU."""
    scene: Any = lent.renderer.device
    state: Any = lent.pixels.device
    model = lent.pixels.model
    assert isinstance(scene, UploadedScene)
    assert isinstance(state, CudaPlainState)
    assert isinstance(model, CudaPlainModel)
    return scene, model, state
