"""The kernels of EvSNet on a GPU, a pixel a thread, and the state that they step.

What pixels fire comes back in the order of the pixels, and is sorted here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.gpu.arrays import DeviceArrays
from evs.emulator.base.gpu.compiler import SCAN_THREADS, kernels_of
from evs.emulator.base.gpu.driver import Gpu
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.native import LANES, NEVER, NativeRuntime
from evs.emulator.evsnet.state import NetworkState, check_growth
from evs.msgs import EVENT_DTYPE, Events, EvsError

KERNELS = (
    "step_pixels",
    "sum_groups",
    "scan_groups",
    "write_crossings",
    "load_rows",
    "store_rows",
)
"""of core/evsnet/gpu/network.cu"""
THREADS = 128
"""of a block, but for `scan_groups`"""
COUNTS = 4
"""spikes, and pixels whose light was replaced, whose X and whose V was clamped"""
SIDE = 4
"""of a tile, px"""
SLOTS = 6
"""past ticks in a FIFO"""
CROSSING_BYTES = 8
LEAST_ROOM = 4096
"""crossings of a tick that there is room for from the start"""


class CudaNetwork:
    """A network on a GPU: its constants, its kernels, and what a tick writes besides the state."""

    def __init__(self, gpu: Gpu, native: NativeRuntime) -> None:
        """Copy the constants there, and compile the kernels unless they are in the cache.

        Args:
            gpu: Where it runs.
            native: Sensor and network; its kernels are not run.

        Raises:
            EvsError: The GPU has no more memory.
        """
        self.gpu, self.native = gpu, native
        gpu.use()
        channels = native.weights.channels
        kernels = kernels_of(gpu, "evsnet/network", KERNELS, {"EVS_CHANNELS": channels})
        self._step, self._sum, self._scan, self._write, self.load_rows, self.store_rows = kernels
        self._layout = _core.DeviceNetwork(native.array)
        self._constants = gpu.allocate(self._layout.constant_bytes)
        gpu.upload(self._constants, self._layout.constants(self._constants.address))
        gpu.wait()
        height, width = native.shape
        self.pixels = height * width
        self.features = 1 + 2 * len(native.weights.blocks) * channels
        """inputs of all convolutions"""
        self._groups = -(-self.pixels // _core.DeviceNetwork.group)
        self._light = gpu.allocate(4 * self.pixels)
        self._tick = {
            "current": gpu.allocate(4 * self.pixels),
            "leaked": gpu.allocate(4 * self.pixels),
            "marks": gpu.allocate(2 * self.pixels),
            "groups": gpu.allocate(4 * COUNTS * self._groups),
            "totals": gpu.allocate(4 * COUNTS),
        }
        self._totals = gpu.pinned((COUNTS,), np.uint32)
        self._make_room(LEAST_ROOM)

    def argument(self, state: CudaNetworkState) -> npt.NDArray[np.uint8]:
        """The first argument of the kernels."""
        scratch = {name: memory.address for name, memory in self._tick.items()}
        return self._layout.argument(self._constants.address, **state.addresses, **scratch)

    def launch(self, kernel: Any, threads: int, *arguments: npt.NDArray[Any]) -> None:
        """Launch a number of threads of a kernel."""
        self.gpu.launch(kernel, (-(-threads // THREADS), 1, 1), THREADS, *arguments)

    def step(
        self,
        luminance: F32 | int,
        state: CudaNetworkState,
        begin_us: int,
        current: F32 | None = None,
    ) -> Events:
        """Step by a tick.

        Args:
            luminance: (h, w) float32, contiguous, or its address on the GPU.
            state: Its arrays, counters and `ticks` move on in place.
            begin_us: Where the tick begins, us.
            current: (h, w) float32, filled where it is given: for tests.

        Returns:
            The events, as in Runtime.step.
        """
        gpu, now = self.gpu, state.numbers
        gpu.use()
        if not isinstance(luminance, int):
            gpu.upload(self._light, luminance)
            luminance = self._light.address
        argument = self.argument(state)
        tick, light = np.array([now.ticks], np.int64), np.array([luminance], np.uint64)
        self.launch(self._step, self.pixels, argument, tick, light)
        self.launch(self._sum, self._groups, argument)
        gpu.launch(self._scan, (COUNTS, 1, 1), SCAN_THREADS, argument)
        state.changed()
        gpu.download(self._totals, self._tick["totals"])
        spikes, clamped, x_clamped, v_clamped = self._totals.tolist()
        now.ticks += 1
        now.clamped += clamped
        now.x_clamped += x_clamped
        now.v_clamped += v_clamped
        if current is not None:
            gpu.download(current, self._tick["current"])
        crossings = self._crossings[: CROSSING_BYTES * spikes]
        if spikes:
            if spikes > self._room:
                self._make_room(2 * spikes)
                crossings = self._crossings[: CROSSING_BYTES * spikes]
            self.launch(self._write, self.pixels, argument, self._crossings_there.argument)
            gpu.download(crossings, self._crossings_there)
        tick_us, width = self.native.weights.tick_us, self.native.shape[1]
        events = _core.order_crossings(crossings, begin_us, tick_us, width, False)
        return events.view(EVENT_DTYPE)

    def _make_room(self, crossings: int) -> None:
        """Have room for so many crossings of a tick."""
        self._room = crossings
        self._crossings_there = self.gpu.allocate(CROSSING_BYTES * crossings)
        self._crossings = self.gpu.pinned((CROSSING_BYTES * crossings,), np.uint8)


class CudaNetworkState:
    """State of a network on a GPU; what is saved is the state of the runtime `native`.

    There, FIFOs are (slot, input of a convolution, h, w), and every pixel has its own. `fetched`
    gives rows of tiles, only to those that remember something where still tiles are left out.
    """

    def __init__(self, network: CudaNetwork, state: NetworkState) -> None:
        """Upload a state.

        Args:
            network: What steps it.
            state: It has been checked; from now on it is this one's.

        Raises:
            EvsError: It is damaged, or the GPU has no more memory.
        """
        self.network, self.numbers = network, state
        """numbers: whose arrays are not those of the last tick"""
        gpu, arrays = network.gpu, state.arrays
        gpu.use()
        tile_row = np.ascontiguousarray(arrays["tile_row"]).reshape(-1)
        fifo = np.ascontiguousarray(arrays["fifo"])
        taken = tile_row[tile_row != -1]
        unlike = len(np.unique(taken)) == len(taken)
        if not (unlike and np.all(taken >= 0) and np.all(taken < len(fifo))):
            raise EvsError("network state cannot be stepped: tile_row is damaged; call init again")
        self._frames: dict[str, np.ndarray[Any, Any]] = {
            name: np.ascontiguousarray(arrays[name])
            for name in ("last_luminance", "last_log", "v", "last")
        }
        self._moved = _in_lines(arrays["tile_moved"], network.native.shape)
        self._there = DeviceArrays(gpu, {**self._frames, "moved": self._moved})
        self._fifo = gpu.allocate(4 * SLOTS * network.features * network.pixels)
        self._copy_rows(network.load_rows, tile_row, fifo)
        # without the rows, which may be many
        self.numbers.arrays = {**arrays, **self._frames, "fifo": fifo[:0].copy()}

    @property
    def addresses(self) -> dict[str, int]:
        """Where each of its arrays lies on the GPU."""
        return {**self._there.addresses, "fifo": self._fifo.address}

    @property
    def clamps(self) -> int:
        """See `NetworkState`."""
        return self.numbers.clamps

    def changed(self) -> None:
        """Kernels that write to it have been launched."""
        self._there.changed()

    def adjust(self, network: CudaNetwork, below: Any) -> None:
        """Go on with another network of the same filters.

        Args:
            network: It.
            below: A function of NetworkState that changes its frames in place.
        """
        self._there.fetch()
        below(self.numbers)
        self._there.push()
        self.network = network

    def fetched(self) -> NetworkState:
        """A copy, as the runtime `native` has it."""
        network, native = self.network, self.network.native
        network.gpu.use()
        self._there.fetch()
        tiles = native.tiles
        moved = _in_tiles(self._moved, tiles, NEVER)
        # what has not moved for so long has zeros in its FIFOs
        since = self.numbers.ticks - SLOTS * len(native.weights.convolutions)
        has_row = np.full(tiles, True) if native.dense else moved.max(axis=2) >= since
        tile_row = np.where(has_row, np.cumsum(has_row).reshape(tiles) - 1, -1).astype(np.int32)
        fifo = self._rows(tile_row)
        v, on, off = self._frames["v"], *native.thresholds
        loud = _in_tiles((v >= on) | (v <= -off), tiles, False).any(axis=2)
        own: dict[str, np.ndarray[Any, Any]] = {
            "fifo": fifo,
            "tile_row": tile_row,
            "tile_moved": moved,
            "tile_loud": np.asarray(loud, np.uint8),
        }
        frames = {name: array.copy() for name, array in self._frames.items()}
        return replace(self.numbers, arrays={**frames, **own})

    def copy(self) -> CudaNetworkState:
        """See `NetworkState`."""
        return CudaNetworkState(self.network, self.fetched())

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """See `NetworkState`."""
        return self.fetched().save()

    def _rows(self, tile_row: npt.NDArray[np.int32]) -> F32:
        """The FIFOs of the tiles that have a row."""
        native = self.network.native
        rows, floats = int(tile_row.max(initial=-1)) + 1, native.row_floats
        capacity = native.capacity(rows)
        height, width = native.shape
        age_us = self.numbers.ticks * native.weights.tick_us
        check_growth(4 * capacity * floats, age_us, width, height)
        fifo = np.zeros((capacity, floats), np.float32)
        self._copy_rows(self.network.store_rows, tile_row.reshape(-1), fifo[:rows])
        # lanes outside the image rest
        inside = _in_tiles(np.full(native.shape, True), native.tiles, False)
        tile, lane = np.nonzero(~inside.reshape(-1, LANES) & (tile_row.reshape(-1, 1) >= 0))
        rest = np.tile(np.concatenate(native.weights.rest()), SLOTS)
        fifo.reshape(capacity, LANES, floats // LANES)[tile_row.reshape(-1)[tile], lane] = rest
        return fifo

    def _copy_rows(self, kernel: Any, tile_row: npt.NDArray[np.int32], rows: F32) -> None:
        """Copy FIFOs from rows of tiles to the GPU, or, with `store_rows`, to there."""
        network = self.network
        gpu = network.gpu
        which, there = gpu.allocate(tile_row.nbytes), gpu.allocate(rows.nbytes)
        gpu.upload(which, tile_row)
        stores = kernel is network.store_rows
        if rows.size and not stores:
            gpu.upload(there, rows)
        argument = network.argument(self)
        network.launch(kernel, network.pixels, argument, which.argument, there.argument)
        if rows.size and stores:
            gpu.download(rows, there)
        gpu.wait()


def _in_tiles(
    pixels: np.ndarray[Any, Any], tiles: tuple[int, int], outside: Any
) -> np.ndarray[Any, Any]:
    """(h', w', 16): an image (h, w) tile by tile."""
    down, across = tiles
    whole = np.full((SIDE * down, SIDE * across), outside, pixels.dtype)
    whole[: pixels.shape[0], : pixels.shape[1]] = pixels
    parts = whole.reshape(down, SIDE, across, SIDE).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(parts).reshape(down, across, LANES)


def _in_lines(tiles: np.ndarray[Any, Any], shape: tuple[int, int]) -> np.ndarray[Any, Any]:
    """(h, w): an image whose tiles are (h', w', 16)."""
    down, across = tiles.shape[:2]
    parts = tiles.reshape(down, across, SIDE, SIDE).transpose(0, 2, 1, 3)
    whole = parts.reshape(SIDE * down, SIDE * across)
    return np.ascontiguousarray(whole[: shape[0], : shape[1]])
