"""StackedArrays: the events of many worlds as one dense array, written natively."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.config.decoding import plain_integer
from evs.emulator.representations import NEVER
from evs.emulator.simulation.worlds import WorldsEvents
from evs.msgs import EvsError, unknown

I64 = npt.NDArray[np.int64]

KINDS = ("event_frame", "voxel_grid", "time_surface", "packet")

FULL = 255
"""bound of event frames and voxel grids, which saturate there; agents normalise by it"""


class StackedArrays:
    """Turns what one camera of each world saw into an array (n, ...), the same in every call.

        grids = StackedArrays("voxel_grid", len(worlds), (64, 64), bins=5)
        (seen,) = worlds.step(controls, ticks=10)
        grids.encode(seen, worlds.t_us - 10_000, worlds.t_us)      # (n, 5, 64, 64) float32
        torch.from_dlpack(grids.array)                             # the same memory

    Row i has the same bytes as the result of the function `kind` in evs.emulator.representations.
    """

    array: npt.NDArray[Any]
    """(n, 2, h, w) uint8 event_frame, at most 255; (n, bins, h, w) float32 voxel_grid, within
    -255 ... 255; (n, 2, h, w) float32 time_surface; (n, capacity, 4) int32 packet"""

    def __init__(
        self,
        kind: str,
        count: int,
        size: tuple[int, int],
        *,
        bins: int = 5,
        tau_us: float = 30_000.0,
        capacity: int = 2048,
        threads: int = 0,
    ) -> None:
        """Make the array.

        Args:
            kind: event_frame | voxel_grid | time_surface | packet
            count: Number of worlds.
            size: (width, height) of the sensor, px.
            bins: Of a voxel grid.
            tau_us: Time constant of a time surface, us.
            capacity: Events of a packet.
            threads: Worlds to step at once; 0: one per core.

        Raises:
            EvsError: An unknown kind, or a value that makes no sense.
        """
        if kind not in KINDS:
            raise unknown("observation", str(kind), KINDS)
        for name, value in (("count", count), ("bins", bins), ("capacity", capacity)):
            if plain_integer(value, name) < 1:
                raise EvsError(f"{name} is {value}: give at least 1")
        if not tau_us > 0.0:
            raise EvsError(f"tau_us is {tau_us}: it must be over 0, for example 30000")
        width, height = (plain_integer(one, "size") for one in size)
        if min(width, height) < 1:
            raise EvsError(f"size is {size}: give (width, height) in px")
        self.kind, self.size, self._tau_us = kind, (width, height), float(tau_us)
        self._native = _core.EventArrays(threads=threads)
        shape: tuple[int, ...] = (count, 2, height, width)
        dtype: type = np.uint8 if kind == "event_frame" else np.float32
        if kind == "voxel_grid":
            shape = (count, bins, height, width)
        elif kind == "packet":
            shape, dtype = (count, capacity, 4), np.int32
        self.array = np.zeros(shape, dtype)
        surface = kind == "time_surface"
        self._stamps = np.full(shape, NEVER, np.int64) if surface else np.zeros(0, np.int64)

    def reset(self, worlds: Iterable[int] | None = None) -> None:
        """Forget the events of some worlds, or of all: their rows are those of no event."""
        chosen = slice(None) if worlds is None else [*worlds]
        self.array[chosen] = 0
        if self.kind == "time_surface":
            self._stamps[chosen] = NEVER

    def go_on_from(self, other: StackedArrays) -> None:
        """Take over the rows of arrays that were made in the same way."""
        self.array[...], self._stamps[...] = other.array, other._stamps

    def encode(
        self, seen: WorldsEvents, begin_us: npt.ArrayLike, end_us: npt.ArrayLike
    ) -> npt.NDArray[Any]:
        """Write the array of these events.

        Args:
            seen: The events of a step.
            begin_us: (n,) where each world's step begins, us: a voxel grid's first bin.
            end_us: (n,) where it ends, us.

        Returns:
            `array`, which the next call overwrites.

        Raises:
            EvsError: Events of another number of worlds, or off the sensor.
        """
        events, offsets = seen.events.view(np.uint8).reshape(-1), seen.offsets
        begin, end = (self._times(one) for one in (begin_us, end_us))
        try:
            if self.kind == "event_frame":
                self._native.event_frame(events, offsets, self.array)
            elif self.kind == "voxel_grid":
                self._native.voxel_grid(events, offsets, begin, end, FULL, self.array)
            elif self.kind == "time_surface":
                surface = (self._stamps, self._tau_us, end, self.array)
                self._native.time_surface(events, offsets, *surface)
            else:
                self._native.packet(events, offsets, end, self.array)
        except ValueError as reason:
            raise EvsError(f"these events do not fit the array of observations: {reason}") from None
        return self.array

    def _times(self, times_us: npt.ArrayLike) -> I64:
        return np.array(np.broadcast_to(np.asarray(times_us, np.int64), (len(self.array),)))
