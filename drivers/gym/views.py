"""What an agent gets of a camera's events: one class for each kind of observation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from evs.drivers.gym.library import spaces
from evs.emulator.representations import (
    decayed,
    event_frame,
    latest_stamps,
    padded_packet,
    voxel_grid,
)
from evs.msgs import Events, empty_events, unknown

FULL = 255
"""Event frames and voxel grids saturate there: a bound is what agents normalise by."""

Size = tuple[int, int]
"""width, height, px"""


@dataclass(frozen=True)
class Step:
    """What happened between two decisions."""

    events: Events
    """(n,) that arrived"""
    begin_us: int
    """time of the first decision"""
    end_us: int
    """time of the second, later"""


class View(Protocol):
    """The events of one camera, of one step after the other, as arrays of one shape."""

    @property
    def space(self) -> spaces.Box:
        """The arrays that `see` gives."""

    def reset(self) -> None:
        """A new episode."""

    def see(self, step: Step) -> npt.NDArray[Any]:
        """A new array."""


class EventFrameView:
    """(2, h, w) uint8: how often each pixel fired in the step, OFF then ON; 255 is that or more."""

    def __init__(self, size: Size) -> None:
        self._size = size
        self.space = spaces.Box(0, FULL, (2, size[1], size[0]), np.uint8)

    def reset(self) -> None:
        """Nothing is kept."""

    def see(self, step: Step) -> npt.NDArray[Any]:
        """Of this step."""
        return np.minimum(event_frame(step.events, self._size), FULL).astype(np.uint8)


class VoxelGridView:
    """(bins, h, w) float32 of -255 ... 255: polarities of the step by pixel and time."""

    def __init__(self, size: Size, bins: int) -> None:
        self._size, self._bins = size, bins
        # refuses a number of bins that is none
        voxel_grid(empty_events(), bins, size)
        self.space = spaces.Box(-FULL, FULL, (bins, size[1], size[0]), np.float32)

    def reset(self) -> None:
        """Nothing is kept."""

    def see(self, step: Step) -> npt.NDArray[Any]:
        """Of this step."""
        interval = (step.begin_us, step.end_us)
        return np.clip(voxel_grid(step.events, self._bins, self._size, interval), -FULL, FULL)


class TimeSurfaceView:
    """(2, h, w) float32 of 0 ... 1: how fresh each pixel's last event is, over all the episode."""

    def __init__(self, size: Size, tau_us: float) -> None:
        self._size, self._tau_us = size, tau_us
        self.space = spaces.Box(0, 1, (2, size[1], size[0]), np.float32)
        self.reset()
        # refuses a time constant that is none
        decayed(self._stamps, tau_us, 0)

    def reset(self) -> None:
        """No pixel has fired."""
        self._stamps = latest_stamps(empty_events(), self._size)

    def see(self, step: Step) -> npt.NDArray[Any]:
        """Of all events since the reset, as of now."""
        self._stamps = latest_stamps(step.events, self._size, self._stamps)
        return decayed(self._stamps, self._tau_us, step.end_us)


class PacketView:
    """(capacity, 4) int32: age in us (0 or less), x, y, polarity 1 or -1 of the last events.

    Rows behind the last one are zeros, polarity too. The newest are kept where there are more.
    """

    def __init__(self, size: Size, capacity: int) -> None:
        self._capacity = capacity
        padded_packet(empty_events(), capacity, 0)
        oldest = np.iinfo(np.int32).min
        low = np.tile(np.array([oldest, 0, 0, -1], np.int32), (capacity, 1))
        high = np.tile(np.array([0, size[0] - 1, size[1] - 1, 1], np.int32), (capacity, 1))
        self.space = spaces.Box(low, high, dtype=np.int32)

    def reset(self) -> None:
        """Nothing is kept."""

    def see(self, step: Step) -> npt.NDArray[Any]:
        """Of this step."""
        return padded_packet(step.events, self._capacity, step.end_us)


def make_view(kind: str, size: Size, bins: int, tau_us: float, capacity: int) -> View:
    """The view called `kind`; EvsError for another name or a value that cannot be."""
    if kind not in KINDS:
        raise unknown("observation", str(kind), KINDS)
    return KINDS[kind](size, bins, tau_us, capacity)


KINDS: dict[str, Callable[[Size, int, float, int], View]] = {
    "event_frame": lambda size, _bins, _tau_us, _capacity: EventFrameView(size),
    "voxel_grid": lambda size, bins, _tau_us, _capacity: VoxelGridView(size, bins),
    "time_surface": lambda size, _bins, tau_us, _capacity: TimeSurfaceView(size, tau_us),
    "packet": lambda size, _bins, _tau_us, capacity: PacketView(size, capacity),
}
"""name of an observation -> what makes its view"""
