"""Observations of a camera's events: one class for each representation."""

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
from evs.emulator.simulation.stacked_arrays import FULL
from evs.msgs import Events, empty_events, unknown

Size = tuple[int, int]
"""width, height, px"""


@dataclass(frozen=True)
class StepEvents:
    """The events between two decisions."""

    events: Events
    """(n,) that arrived"""
    begin_us: int
    """time of the first decision"""
    end_us: int
    """time of the second, later"""


class EventObservation(Protocol):
    """Turns the events of each step of one camera into an array of one shape."""

    @property
    def space(self) -> spaces.Box:
        """Space of the arrays that `observe` returns."""

    def reset(self) -> None:
        """Start a new episode."""

    def observe(self, step: StepEvents) -> npt.NDArray[Any]:
        """The array of the next step."""


class EventFrameObservation:
    """(2, h, w) uint8: how often each pixel fired in the step, OFF then ON; 255 is that or more."""

    def __init__(self, size: Size) -> None:
        self._size = size
        self.space = spaces.Box(0, FULL, (2, size[1], size[0]), np.uint8)

    def reset(self) -> None:
        """Keeps no state."""

    def observe(self, step: StepEvents) -> npt.NDArray[Any]:
        """The array of this step alone."""
        return np.minimum(event_frame(step.events, self._size), FULL).astype(np.uint8)


class VoxelGridObservation:
    """(bins, h, w) float32 of -255 ... 255: polarities of the step by pixel and time."""

    def __init__(self, size: Size, bins: int) -> None:
        self._size, self._bins = size, bins
        # refuses a number of bins that is none
        voxel_grid(empty_events(), bins, size)
        self.space = spaces.Box(-FULL, FULL, (bins, size[1], size[0]), np.float32)

    def reset(self) -> None:
        """Keeps no state."""

    def observe(self, step: StepEvents) -> npt.NDArray[Any]:
        """The array of this step alone."""
        interval = (step.begin_us, step.end_us)
        return np.clip(voxel_grid(step.events, self._bins, self._size, interval), -FULL, FULL)


class TimeSurfaceObservation:
    """(2, h, w) float32 of 0 ... 1: how fresh each pixel's last event is, over all the episode."""

    def __init__(self, size: Size, tau_us: float) -> None:
        self._size, self._tau_us = size, tau_us
        self.space = spaces.Box(0, 1, (2, size[1], size[0]), np.float32)
        self.reset()
        # refuses a time constant that is none
        decayed(self._stamps, tau_us, 0)

    def reset(self) -> None:
        """Forget all events."""
        self._stamps = latest_stamps(empty_events(), self._size)

    def observe(self, step: StepEvents) -> npt.NDArray[Any]:
        """The array of all events since the reset, at the end of this step."""
        self._stamps = latest_stamps(step.events, self._size, self._stamps)
        return decayed(self._stamps, self._tau_us, step.end_us)


class PacketObservation:
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
        """Keeps no state."""

    def observe(self, step: StepEvents) -> npt.NDArray[Any]:
        """The array of this step alone."""
        return padded_packet(step.events, self._capacity, step.end_us)


def make_event_observation(
    kind: str, size: Size, bins: int, tau_us: float, capacity: int
) -> EventObservation:
    """Make the observation of this kind for one camera.

    Args:
        kind: One of KINDS.
        size: Width, height of the sensor, px.
        bins: Bins of a voxel grid.
        tau_us: Time constant of a time surface, us.
        capacity: Events of a packet.

    Raises:
        EvsError: The kind is unknown, or a value is not possible.
    """
    if kind not in KINDS:
        raise unknown("observation", str(kind), KINDS)
    return KINDS[kind](size, bins, tau_us, capacity)


KINDS: dict[str, Callable[[Size, int, float, int], EventObservation]] = {
    "event_frame": lambda size, _bins, _tau_us, _capacity: EventFrameObservation(size),
    "voxel_grid": lambda size, bins, _tau_us, _capacity: VoxelGridObservation(size, bins),
    "time_surface": lambda size, _bins, tau_us, _capacity: TimeSurfaceObservation(size, tau_us),
    "packet": lambda size, _bins, _tau_us, capacity: PacketObservation(size, capacity),
}
"""name of an observation -> its constructor"""
