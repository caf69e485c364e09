"""`hybrid` on a GPU: the kernel of the native core, a pixel a thread.

The irradiance cache stays on the CPU, which lights its nodes. The GPU reads a copy of it, and lists
the nodes that its pixels miss.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.gpu.arrays import DeviceLight, power_from
from evs.emulator.base.gpu.compiler import kernels_of
from evs.emulator.base.gpu.driver import Gpu, the_gpu
from evs.emulator.base.scene import F32
from evs.emulator.render.device import Poses
from evs.emulator.render.gpu.scene import THREADS, GpuDevice, UploadedScene

HEAD_BYTES = 16
"""in front of the nodes' marks: how many nodes are missing, and how often one was read, uint32"""
LEAST_MISSING = 4096
"""missing nodes of a pass that there is room for"""
HIT_WORDS, NO_HIT = 3, np.uint64(2**64 - 1)
"""as in core/render/irradiance/first_readers.h"""


class HybridOnGpu(GpuDevice):
    """The bytes of the CPU, which traces the tick that fills the empty cache."""

    why_not_lent = "a GPU renders soft light camera by camera"

    def __init__(
        self, caster: _core.Caster, shape: tuple[int, int], samples: int, shared: object
    ) -> None:
        """See GpuDevice."""
        del samples, shared
        gpu = the_gpu()
        super().__init__(gpu, caster, shape)
        scene, adaptive = self._scene, self._scene.adaptive
        size = self.luminance.nbytes if adaptive else 0
        self._base, self._untextured = scene.room(size), scene.room(size)
        passes = ("hybrid", "hybrid_at_edges") if adaptive else ("hybrid",)
        macros = {"EVS_CHANNELS": caster.channels, "EVS_ADAPTIVE": int(adaptive)}
        offer, *self._kernels = kernels_of(gpu, "render/hybrid", ("offer_readers", *passes), macros)
        self._cache = UploadedCache(gpu, scene, offer)
        self.is_fetched = True
        """whether `luminance` is the light of the last tick"""

    def render(self, poses: Poses, seed: int, into: F32 | None) -> F32:
        """See Device."""
        scene = self._scene
        if scene.upload(poses, seed) == "there":
            self.is_fetched = not self._trace()
            if self.is_fetched:
                scene.layout.trace_here(self.luminance)
                scene.put_light()
        if isinstance(into, DeviceLight):
            scene.copy_light(into)
            return into  # NumPy takes it as an array
        self.fetch()
        if into is None:
            return self.luminance
        np.copyto(into, self.luminance)
        return into

    def _trace(self) -> bool:
        """Trace the passes of a tick there; False: the cache has no room, or was empty."""
        scene, trace = self._scene, self._cache.trace
        light = scene.light.argument
        if not scene.adaptive:
            return trace(False, self._kernels[0], scene.frame, light, np.zeros(1, np.uint64))
        base, untextured = self._base.argument, self._untextured.argument
        first, second = self._kernels
        return trace(False, first, scene.first_pass, base, untextured) and trace(
            True, second, scene.frame, base, untextured, light
        )

    def fetch(self) -> None:
        """See Device."""
        if not self.is_fetched:
            self._scene.download(None)
            self.is_fetched = True

    def replace_light(self) -> None:
        """See Device."""
        self._scene.put_light()
        self.is_fetched = True


class UploadedCache:
    """The irradiance cache on a GPU, as one pass over the pixels reads it."""

    def __init__(self, gpu: Gpu, there: UploadedScene, offer: object) -> None:
        """Make room for a few nodes.

        Args:
            gpu: Where it lies.
            there: The scene, of a caster of `hybrid`.
            offer: The kernel `offer_readers`.

        Raises:
            EvsError: The GPU has no more memory.
        """
        self._gpu, self._there, self._offer = gpu, there, offer
        self._size = self._nodes = 0
        self._fit(1 << 20, 1 << 12)
        layout = there.layout
        self._missing = DeviceList(gpu, layout.request_bytes, LEAST_MISSING)
        self._readers = DeviceList(gpu, layout.reader_bytes, 1)

    def trace(
        self, edges: bool, kernel: object, frame: npt.NDArray[np.uint8], *arguments: Any
    ) -> bool:
        """Trace a pass, and again with the nodes that it missed until none is missing.

        Args:
            edges: Whether it is the pass over pixels at edges.
            kernel: Of `hybrid`.
            frame: Its first argument.
            arguments: Its last ones.

        Returns:
            False where the cache has no room for the nodes, or was empty.

        Raises:
            EvsError: The GPU has no more memory.
        """
        gpu, there = self._gpu, self._there
        missing, readers = self._missing, self._readers
        while True:
            used = self._upload(edges)
            lists = np.array(
                [
                    self._found.address,
                    missing.memory.address,
                    readers.memory.address,
                    missing.room | readers.room << 32,
                ],
                np.uint64,
            )
            there.launch(kernel, frame, there.paths, there.cache, lists, *arguments)
            gpu.download(self._head[: HEAD_BYTES + len(used)], self._found)
            wanted, read = self._head[:8].view(np.uint32).tolist()
            fits = missing.fit(wanted)
            if not readers.fit(read) or not fits:
                continue
            if not there.layout.take_nodes(used, missing.download(wanted)):
                return False
            if not wanted:
                break
        if read:
            self._take_readers(read)
        return True

    def _take_readers(self, count: int) -> None:
        """Find the first reader of each node, and hand them to the cache."""
        gpu, layout = self._gpu, self._there.layout
        first = gpu.pinned((layout.nodes, HIT_WORDS), np.uint64)
        first[:] = NO_HIT
        there = gpu.allocate(first.nbytes)
        gpu.upload(there, first)
        grid = (-(-count // THREADS), 1, 1)
        readers, many = self._readers.memory.argument, np.array([count], np.uint32)
        for word in range(HIT_WORDS):
            which = np.array([word], np.int32)
            gpu.launch(self._offer, grid, THREADS, readers, many, which, there.argument)
        gpu.download(first, there)
        layout.take_readers(first)

    def _upload(self, edges: bool) -> npt.NDArray[np.uint8]:
        """Begin a pass. Returns the marks of the nodes, which come back with what it finds."""
        gpu, layout = self._gpu, self._there.layout
        size, nodes = layout.cache_bytes, layout.nodes
        self._fit(size, nodes)
        self._head[:HEAD_BYTES] = 0
        used = self._head[HEAD_BYTES : HEAD_BYTES + nodes]
        layout.copy_cache(
            edges,
            self._memory.address,
            self._found.address + HEAD_BYTES,
            self._here[:size],
            used,
            self._there.arguments,
        )
        gpu.upload(self._memory, self._here[:size])
        gpu.upload(self._found, self._head[: HEAD_BYTES + nodes])
        return used

    def _fit(self, size: int, nodes: int) -> None:
        """Have memory for so many bytes of the cache, and so many nodes."""
        gpu = self._gpu
        if size > self._size:
            self._size = power_from(size)
            self._here = gpu.pinned((self._size,), np.uint8)
            self._memory = gpu.allocate(self._size)
        if nodes > self._nodes:
            self._nodes = power_from(nodes)
            self._head = gpu.pinned((HEAD_BYTES + self._nodes,), np.uint8)
            self._found = gpu.allocate(HEAD_BYTES + self._nodes)


class DeviceList:
    """A list to which the threads of a kernel append, in no order."""

    def __init__(self, gpu: Gpu, each: int, room: int) -> None:
        """Make room.

        Args:
            gpu: Where it lies.
            each: Bytes of an entry.
            room: How many entries there is room for.

        Raises:
            EvsError: The GPU has no more memory.
        """
        self._gpu, self._each = gpu, each
        self._here: npt.NDArray[np.uint8] | None = None
        self._make(room)

    def fit(self, count: int) -> bool:
        """Whether there was room for so many; there is afterwards."""
        if count <= self.room:
            return True
        self._make(power_from(count))
        return False

    def download(self, count: int) -> npt.NDArray[np.uint8]:
        """The bytes of the first so many; the array is valid until the next call."""
        if self._here is None:
            self._here = self._gpu.pinned((self.room * self._each,), np.uint8)
        rows = self._here[: count * self._each]
        if count:
            self._gpu.download(rows, self.memory)
        return rows

    def _make(self, room: int) -> None:
        self.room = room
        self.memory = self._gpu.allocate(room * self._each)
        self._here = None
