"""Observation: everything that a controller receives at a decision."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.frame import Frame
from evs.msgs.imu import ImuPacket
from evs.msgs.packet import EventPacket

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Observation:
    """The messages that arrived up to a decision. Nothing else writes to its arrays.

    It holds no reference to the simulator.
    """

    t_us: int
    """simulated time of the decision, us; nothing in it is stamped later"""
    packets: tuple[EventPacket, ...]
    """every camera's packets that arrived since the last decision, by their end, then by camera"""
    position: F64
    """(n,) the actuators' encoders: length of each one's transmission (rad, m, times its gear)"""
    velocity: F64
    """(n,) its change, 1/s of that"""
    done: str = ""
    """why the episode is over; empty: it continues"""
    state: F64 | None = None
    """(n,) mjSTATE_INTEGRATION; None unless requested at reset"""
    frames: tuple[Frame, ...] = ()
    """intensity frames that arrived since, by their end; none unless sensor.aps is enabled"""
    imu: tuple[ImuPacket, ...] = ()
    """IMU samples that arrived since; none unless sensor.imu is enabled"""

    def __eq__(self, other: object) -> bool:
        """Same bits everywhere."""
        if not isinstance(other, Observation):
            return NotImplemented
        return bool(_bits(self) == _bits(other))

    __hash__ = None  # type: ignore[assignment]


def _bits(value: Any) -> Any:
    """A value with bytes in place of its arrays."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, tuple):
        return tuple(_bits(one) for one in value)
    if isinstance(value, Observation | EventPacket | Frame | ImuPacket):
        return tuple(_bits(getattr(value, field.name)) for field in fields(value))
    return value
