"""TriggerPacket: instants that a camera marks, such as edges at its connector and frame phases."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np

from evs.msgs.frame import Frame

TRIGGER_DTYPE = np.dtype([("t", "<i8"), ("kind", "i1")])
"""t int64 us of simulated time; kind a Trigger."""

Triggers = np.ndarray[Any, np.dtype[np.void]]
"""(n,) TRIGGER_DTYPE, sorted by t."""


class Trigger(IntEnum):
    """The kind of a trigger. Names and numbers are AEDAT4's (dv-processing's TriggerType)."""

    TIMESTAMP_RESET = 0
    EXTERNAL_SIGNAL_RISING_EDGE = 1
    EXTERNAL_SIGNAL_FALLING_EDGE = 2
    EXTERNAL_SIGNAL_PULSE = 3
    EXTERNAL_GENERATOR_RISING_EDGE = 4
    EXTERNAL_GENERATOR_FALLING_EDGE = 5
    APS_FRAME_START = 6
    APS_FRAME_END = 7
    APS_EXPOSURE_START = 8
    APS_EXPOSURE_END = 9


@dataclass(frozen=True, eq=False)
class TriggerPacket:
    """The triggers of one tick (or more) of one camera."""

    seq: int
    """Counts this camera's trigger packets from 0, without gaps."""
    triggers: Triggers = field(default_factory=lambda: empty_triggers())
    """(n,) TRIGGER_DTYPE, sorted by t."""
    camera: str = "camera"
    """Name of the camera that marked them."""

    def __len__(self) -> int:
        return len(self.triggers)

    def __repr__(self) -> str:
        return f"<TriggerPacket {self.seq} of '{self.camera}': {len(self)} triggers>"

    def __eq__(self, other: object) -> bool:
        """Same name and number, same bytes."""
        if not isinstance(other, TriggerPacket):
            return NotImplemented
        same = self.triggers.tobytes() == other.triggers.tobytes()
        return (self.seq, self.camera) == (other.seq, other.camera) and same

    __hash__ = None  # type: ignore[assignment]


def empty_triggers(count: int = 0) -> Triggers:
    """`count` zeroed triggers."""
    return np.zeros(count, TRIGGER_DTYPE)


def make_triggers(marks: Iterable[tuple[int, int]]) -> Triggers:
    """Triggers from pairs (t in us, kind), sorted by t; the order within one instant is kept."""
    return np.array(sorted(marks, key=lambda mark: mark[0]), TRIGGER_DTYPE)


def external_triggers(t_us: Any, rising: Any) -> Triggers:
    """Make triggers of edges at a camera's connector, whichever of its inputs they came from.

    Args:
        t_us: (n,) time stamps, us.
        rising: (n,) whether each edge rises.

    Returns:
        (n,) TRIGGER_DTYPE, in the given order.
    """
    triggers = empty_triggers(len(t_us))
    triggers["t"] = t_us
    triggers["kind"] = np.where(
        rising, Trigger.EXTERNAL_SIGNAL_RISING_EDGE, Trigger.EXTERNAL_SIGNAL_FALLING_EDGE
    )
    return triggers


def frame_triggers(frame: Frame) -> Triggers:
    """(4,) start and end of a frame and of its exposure, as a DAVIS marks them."""
    return make_triggers(
        (
            (frame.begin_us, Trigger.APS_FRAME_START),
            (frame.exposure_begin_us, Trigger.APS_EXPOSURE_START),
            (frame.exposure_end_us, Trigger.APS_EXPOSURE_END),
            (frame.end_us, Trigger.APS_FRAME_END),
        )
    )
