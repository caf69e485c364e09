"""A server's description of itself, for clients."""

from __future__ import annotations

from typing import Any

from evs.drivers.lockstep.clients import Clients
from evs.drivers.lockstep.loop_interface import ServedLoop
from evs.msgs import StreamInfo
from evs.msgs.lockstep import LOCKSTEP_PROTOCOL

_STREAM = ("camera", "width", "height", "sensor", "tick_us", "seed", "latency_us")


def description(loop: ServedLoop, clients: Clients) -> dict[str, Any]:
    """Describe cameras, actuators and who is here, as plain values of a header."""
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
