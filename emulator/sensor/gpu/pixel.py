"""The pixels of `plain` and `adaptive` on a GPU, a block of 64 pixels a thread.

Their state lies there. What they have found comes back in the order of the pixels, and is sorted
here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.arrays import Arrays
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.gpu.arrays import ALIGNMENT, DeviceArrays, DeviceLight, power_from
from evs.emulator.base.gpu.compiler import SCAN_THREADS, kernels_of
from evs.emulator.base.gpu.driver import DeviceMemory, Gpu, the_gpu
from evs.emulator.sensor.parameters import ModelRequest, SensorParameters
from evs.emulator.sensor.pixel import (
    BLOCK,
    STATE,
    PlainModel,
    PlainState,
    check_tick,
)
from evs.emulator.sensor.running_mean import RunningMeanConstants
from evs.msgs import EVENT_DTYPE, Events, EvsError

THREADS = 64
"""of a block of the GPU, but for `place_crossings`"""
LOGS = ("linlog", "log_eps", "ln")
"""as LogKind of core/sensor/log_map.h"""
FILTERS = ("exact", "euler", "large_signal")
"""as EVS_FILTER of core/sensor/gpu/pixels.cu"""
CROSSING_BYTES, CANDIDATE_BYTES, COUNTS_BYTES = 8, 16, 12
ALL_BYTES = 16
"""of TickCounts in core/sensor/device_pixels.h, in front of the packed crossings"""
LEAST_ROOM = 4096
"""crossings of a tick that are downloaded at once, at least"""


class CudaPlainState:
    """State of pixels on a GPU: what PlainState has, which is here where it was fetched."""

    def __init__(self, gpu: Gpu, state: PlainState) -> None:
        """Upload a state.

        Args:
            gpu: Where it lies.
            state: From now on it is this one's.

        Raises:
            EvsError: The GPU has no more memory.
        """
        self.numbers = state
        """whose numbers are those of the last tick, unlike its arrays"""
        self.there = DeviceArrays(gpu, state.arrays())

    def fetched(self) -> PlainState:
        """It, with the arrays of the last tick."""
        self.there.fetch()
        return self.numbers

    def save(self) -> dict[str, npt.NDArray[Any]]:
        """See `PlainState`."""
        return self.fetched().save()

    @property
    def clamps(self) -> int:
        """See `PlainState`."""
        return self.numbers.clamps


class CudaPlainModel(PlainModel):
    """EventModel `plain` or `adaptive` on a GPU, with the events and states of PlainModel."""

    on_device = True
    """it takes light from there"""

    def __init__(
        self,
        sensor: SensorParameters,
        threads: int = 0,
        isa: str = "auto",
        *,
        average: RunningMeanConstants | None = None,
        causes: bool = False,
        switches: Switches = UNFORCED,
    ) -> None:
        """Compile the kernels unless they are in the cache; nothing is drawn yet.

        Args:
            sensor: See `PlainModel`.
            threads: See `PlainModel`.
            isa: See `PlainModel`.
            average: See `PlainModel`.
            causes: See `PlainModel`.
            switches: See `PlainModel`.

        Raises:
            EvsError: There is no GPU.
        """
        super().__init__(sensor, threads, isa, average=average, causes=causes, switches=switches)
        self._gpu = gpu = the_gpu()
        gpu.use()
        self.kernel_terms = {
            "EVS_PHOTON_NOISE": int("photon_noise" in self.terms),
            "EVS_RUNNING_MEAN": int("running_mean" in self.terms),
            "EVS_SHOT_NOISE": int("shot_noise" in self.terms),
            "EVS_LOG": LOGS.index(self.sensor.log),
            "EVS_FILTER": FILTERS.index(self.sensor.filter),
        }
        """macros of the kernels: what is off is not compiled"""
        self._step, self._place, self._pack = pixel_kernels(gpu, self.kernel_terms)
        self._light = DeviceLight(gpu, (sensor.height, sensor.width))
        self._blocks = -(-sensor.width * sensor.height // BLOCK)
        self._grid = (-(-self._blocks // THREADS), 1, 1)
        self._scratch = PixelScratch(gpu, self._blocks)
        self._uploaded: tuple[_core.PixelArray, DevicePattern] | None = None

    def init(self, seed: int) -> Any:
        """The state before the first tick."""
        return CudaPlainState(self._gpu, super().init(seed))

    def restore(self, saved: Arrays) -> Any:
        """EventModel.restore."""
        return CudaPlainState(self._gpu, super().restore(saved))

    def take_over(self, state: Any, before: object) -> Any:
        """EventModel.take_over: as in PlainModel."""
        changed = super().take_over(_checked(state).fetched(), before)
        state.there.push()
        state.numbers = changed
        return state

    def step(
        self, luminance: Any, state: Any, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, Any]:
        """See `PlainModel.step`.

        Args:
            luminance: (h, w) float32, linear, here or on the GPU (DeviceLight).
            state: It is consumed.
            t_begin_us: Where the tick begins, us.
            t_end_us: Where it ends, us.

        Returns:
            The events in (t_begin_us, t_end_us], as in PlainModel.step, and the state.

        Raises:
            EvsError: Wrong shape, a tick that does not go forward, more events than memory.
        """
        now = _checked(state).numbers
        check_tick(self.sensor, luminance, now, t_begin_us, t_end_us)
        tick_us = t_end_us - t_begin_us
        self._gpu.use()
        if now.due_us is not None and tick_us != now.tick_us:
            # filters that stand still in short ticks may move in a longer one
            state.fetched().due_us[:] = now.clock_us
            state.there.push()
        if not isinstance(luminance, DeviceLight):
            self._light.put(np.ascontiguousarray(luminance, np.float32))
            luminance = self._light
        crossings, clamped = self._stepped(luminance, state, t_begin_us, t_end_us)
        now.all_due = 0
        now.clamped += clamped
        now.clock_us += tick_us
        now.tick_us = tick_us
        now.ticks += 1
        width, causes = self.sensor.width, "causes" in self.terms
        events = _core.order_crossings(crossings, t_begin_us, tick_us, width, causes)
        return events.view(EVENT_DTYPE), state

    def _stepped(
        self, light: DeviceLight, state: CudaPlainState, t_begin_us: int, t_end_us: int
    ) -> tuple[npt.NDArray[np.uint8], int]:
        """The crossings of a tick in the order of the pixels, and the pixels that were clamped."""
        now, scratch, gpu = state.numbers, self._scratch, self._gpu
        pattern = self.pattern_on_device(now.seed)
        reads = None if self._row_reads is None else self._row_reads.within(t_begin_us, t_end_us)
        state.there.keep()
        stepped = False
        while True:
            argument = pattern.argument(light, state, t_end_us - t_begin_us, reads, scratch)
            if not stepped:
                gpu.launch(self._step, self._grid, THREADS, argument)
                state.there.changed()
                stepped = True
            found = scratch.pack(self._place, self._pack, self._blocks)
            if scratch.is_short(found):
                # again, with room for what a block needs
                state.there.put_back()
                scratch.make_blocks(found)
                stepped = False
            elif found.crossings > scratch.room:
                scratch.make_room(found.crossings)
            else:
                return scratch.packed(found.crossings), found.clamped

    def pattern_on_device(self, seed: int) -> DevicePattern:
        """The fixed pattern on the GPU; the last one is kept."""
        array = self.array(seed)
        if self._uploaded is None or self._uploaded[0] is not array:
            self._uploaded = array, DevicePattern(self._gpu, array)
        return self._uploaded[1]


class DevicePattern:
    """The fixed pattern of pixels on a GPU, and the argument of their kernels."""

    def __init__(self, gpu: Gpu, array: _core.PixelArray) -> None:
        """Upload it.

        Args:
            gpu: Where to.
            array: The pixels, which have it.

        Raises:
            EvsError: The GPU has no more memory.
        """
        self._gpu, self.layout = gpu, _core.DevicePixels(array)
        self.constant = gpu.allocate(self.layout.constant_bytes)
        """the pattern"""
        constant = np.empty(self.layout.constant_bytes, np.uint8)
        self.layout.copy_constant(self.constant.address, constant)
        gpu.upload(self.constant, constant)
        gpu.wait()
        self._argument = np.zeros(self.layout.argument_bytes, np.uint8)
        self._reads: DeviceMemory | None = None

    def argument(
        self,
        light: DeviceLight,
        state: CudaPlainState,
        tick_us: int,
        reads: npt.NDArray[np.int32] | None,
        scratch: PixelScratch,
    ) -> npt.NDArray[np.uint8]:
        """The argument of the kernels for a tick."""
        row_reads = 0
        if reads is not None and len(reads):
            self._reads = self._gpu.allocate(reads.nbytes)
            self._gpu.upload(self._reads, np.ascontiguousarray(reads))
            self._gpu.wait()
            row_reads = self._reads.address
        now = state.numbers
        self.layout.copy_arguments(
            constant=self.constant.address,
            arrays=state.there.addresses,
            luminance=light.memory.address,
            clock_us=now.clock_us,
            tick_us=tick_us,
            ticks=now.ticks,
            all_due=bool(now.all_due),
            row_reads=row_reads,
            row_read_count=0 if reads is None else len(reads),
            room=scratch.block_room,
            out=self._argument,
        )
        return self._argument


class TickCounts(NamedTuple):
    """TickCounts of core/sensor/device_pixels.h: what all blocks found in a tick."""

    crossings: int
    most_crossings: int
    """of a block"""
    most_candidates: int
    """of shot noise, of a block"""
    clamped: int
    """pixels with unusable luminance"""


class PixelScratch:
    """What the kernels of pixels write besides their state."""

    def __init__(self, gpu: Gpu, blocks: int) -> None:
        """Allocate it.

        Args:
            gpu: Where it lies.
            blocks: Of 64 pixels, of all cameras.

        Raises:
            EvsError: The GPU has no more memory.
        """
        self._gpu, self._blocks = gpu, blocks
        self.counts = gpu.allocate(COUNTS_BYTES * blocks)
        """(blocks,) BlockCounts"""
        self.offsets = gpu.allocate(4 * blocks)
        """(blocks,) uint32, where the crossings of each block begin among those that are packed"""
        self._offsets_here: npt.NDArray[np.uint32] | None = None
        self.crossings = self.candidates = 0
        """of each block there is room for"""
        self.make_blocks(TickCounts(0, BLOCK, 16, 0))
        self.make_room(LEAST_ROOM)

    @property
    def block_room(self) -> tuple[int, int, int, int, int]:
        """Where blocks write what they find, and how much room each has: DevicePixels."""
        found, drawn = self.slots.address, self.drawn.address
        return found, self.crossings, drawn, self.candidates, self.counts.address

    def is_short(self, found: TickCounts) -> bool:
        """Whether a block had more than there was room for."""
        return found.most_crossings > self.crossings or found.most_candidates > self.candidates

    def make_blocks(self, found: TickCounts) -> None:
        """Make room for what a block had."""
        self.crossings = max(power_from(found.most_crossings), self.crossings)
        self.candidates = max(power_from(found.most_candidates), self.candidates)
        self.slots = self._gpu.allocate(CROSSING_BYTES * self.crossings * self._blocks)
        self.drawn = self._gpu.allocate(CANDIDATE_BYTES * self.candidates * self._blocks)

    def make_room(self, crossings: int) -> None:
        """Make room for so many crossings of a tick."""
        self.room = power_from(crossings)
        size = ALL_BYTES + CROSSING_BYTES * self.room
        self.found = self._gpu.allocate(size)
        self._here = self._gpu.pinned((size,), np.uint8)
        self._expect(0)

    def _expect(self, crossings: int) -> None:
        """Download room for a few more than so many with the counts, which saves a wait."""
        likely = min(max(crossings + crossings // 4, LEAST_ROOM), self.room)
        self._first = ALL_BYTES + CROSSING_BYTES * likely

    def pack(self, place: object, pack: object, count: int) -> TickCounts:
        """Pack the crossings of blocks, and wait.

        Args:
            place: The kernel `place_crossings`.
            pack: The kernel `pack_crossings`.
            count: How many blocks were stepped.
        """
        counts, offsets, found = (
            memory.argument for memory in (self.counts, self.offsets, self.found)
        )
        blocks, slots = np.array([count], np.uint32), self.slots.argument
        each, room = np.array([self.crossings], np.uint32), np.array([self.room], np.uint32)
        packed = found + np.uint64(ALL_BYTES)
        grid = (-(-count // THREADS), 1, 1)
        launch = self._gpu.launch
        launch(place, (1, 1, 1), SCAN_THREADS, counts, blocks, offsets, found)
        launch(pack, grid, THREADS, counts, blocks, slots, each, offsets, found, room, packed)
        self._gpu.download(self._here[: self._first], self.found)
        return TickCounts(*self._here[:ALL_BYTES].view(np.uint32).tolist())

    def offsets_of(self, blocks: int) -> npt.NDArray[np.uint32]:
        """Where the crossings of the first so many blocks begin among those that are packed.

        The array is valid until the next call.
        """
        if self._offsets_here is None:
            self._offsets_here = self._gpu.pinned((self._blocks,), np.uint32)
        found = self._offsets_here[:blocks]
        self._gpu.download(found, self.offsets)
        return found

    def clamped_of(self, blocks: int) -> npt.NDArray[np.uint32]:
        """How many pixels of the first so many blocks had unusable luminance."""
        found = np.empty((blocks, COUNTS_BYTES // 4), np.uint32)
        self._gpu.download(found, self.counts)
        return found[:, 2]

    def packed(self, count: int) -> npt.NDArray[np.uint8]:
        """The bytes of so many crossings."""
        size = ALL_BYTES + CROSSING_BYTES * count
        if size > self._first:
            self._gpu.download(self._here[:size], self.found)
        self._expect(count)
        return self._here[ALL_BYTES:size]


def pixel_kernels(gpu: Gpu, terms: Mapping[str, int], many: bool = False) -> list[Any]:
    """The kernels that step the pixels, place their crossings and pack them.

    Args:
        gpu: Where they run.
        terms: CudaPlainModel.kernel_terms.
        many: Whether a launch steps many cameras.

    Raises:
        EvsError: See `compile_kernel`.
    """
    step = "step_blocks_of_many" if many else "step_blocks"
    names = step, "place_crossings", "pack_crossings"
    macros = {**terms, "EVS_MANY": 1} if many else terms
    # which fills the table of photon noise
    return kernels_of(gpu, "sensor/pixels", names, macros, prepare="prepare")


def most_state_bytes(pixels: int) -> int:
    """Bytes that the state of so many pixels has at most, laid out by base.gpu.arrays."""
    sizes = [np.dtype(a.dtype).itemsize * -(-pixels // a.pixels) for a in STATE]
    return sum(-(-size // ALIGNMENT) * ALIGNMENT for size in sizes)


def _checked(state: Any) -> CudaPlainState:
    """A state of pixels on a GPU. Raises EvsError for others."""
    if not isinstance(state, CudaPlainState):
        raise EvsError(f"state is a {type(state).__name__}, not of a GPU; call init again")
    return state


def plain_model(
    request: ModelRequest, average: RunningMeanConstants | None = None
) -> CudaPlainModel:
    """The event model `plain`."""
    return CudaPlainModel(
        request.sensor,
        request.threads,
        request.isa,
        average=average,
        causes=request.model.labels,
        switches=request.switches,
    )


def adaptive_model(request: ModelRequest) -> CudaPlainModel:
    """The event model `adaptive`."""
    return plain_model(request, RunningMeanConstants())
