"""The closed loop that a server serves: its interface, and its description for clients."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy.typing as npt

from evs.drivers.lockstep.clients import Clients
from evs.msgs import Observation, StreamInfo
from evs.msgs.lockstep import F64, LOCKSTEP_PROTOCOL

_STREAM = ("camera", "width", "height", "sensor", "tick_us", "seed", "latency_us")


class ServedLoop(Protocol):
    """What a server needs of a closed loop; ServedRun (drivers/lockstep/serve.py) is one."""

    def reset(
        self, seed: int | None = None, keyframe: str = "", state: bool = False
    ) -> Observation:
        """Begin an episode."""

    def step(self, ctrl: npt.ArrayLike | None = None, ticks: int = 1) -> Observation:
        """Apply a control and advance by some ticks."""

    def save(self, compress: bool = False) -> bytes:
        """Return the whole state."""

    def restore(self, blob: bytes) -> Observation:
        """Return to a saved state."""

    @property
    def actuators(self) -> Sequence[str]:
        """Names of all actuators, in the order of the controls."""

    @property
    def ctrl(self) -> F64:
        """(nu,) the last controls that were decided, whether they act yet or not."""

    @property
    def ctrl_range(self) -> F64:
        """(nu, 2) lowest and highest control of each actuator; infinite where there is no limit."""

    @property
    def streams(self) -> Sequence[StreamInfo]:
        """What is constant of each camera."""

    @property
    def tick_us(self) -> int:
        """Length of a tick, us."""

    @property
    def t_us(self) -> int:
        """Simulated time, us."""

    @property
    def done(self) -> str:
        """Why the episode is over; "": it goes on, or has not begun."""


def description(loop: ServedLoop, clients: Clients) -> dict[str, Any]:
    """Describe the cameras, the actuators and the clients, as plain values of a header."""
    return {
        "protocol": LOCKSTEP_PROTOCOL,
        "tick_us": loop.tick_us,
        "actuators": list(clients.actuators),
        "cameras": [_stream(stream) for stream in loop.streams],
        "controllers": clients.controllers,
        "joined": [client.name for client in clients.present.values()],
    }


def camera_of(described: dict[str, Any]) -> StreamInfo:
    """Return a camera of a description."""
    return StreamInfo(
        **{key: described[key] for key in _STREAM}, frames=described["frames"], imu=described["imu"]
    )


def _stream(stream: StreamInfo) -> dict[str, Any]:
    plain = {key: getattr(stream, key) for key in _STREAM}
    return {**plain, "frames": stream.frames, "imu": stream.imu}
