"""A camera, its packets and a server of them, for the tests of the DV server."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from evs.drivers.dv import DvServer
from evs.msgs import EventPacket, StreamInfo, make_events

ALL = StreamInfo(346, 260, camera="eye", frames=True, imu=True, triggers=True)
ANY = "tcp://127.0.0.1:0"
TICKS = 60


def packet(seq: int, count: int, begin_us: int = 0, camera: str = "eye") -> EventPacket:
    random = np.random.default_rng(seq)
    begin = begin_us + 1000 * seq
    t = np.sort(random.integers(begin + 1, begin + 1001, count))
    x, y = random.integers(0, 346, count), random.integers(0, 260, count)
    return EventPacket(seq, begin, begin + 1000, 346, 260, make_events(t, x, y, t % 2), camera)


@contextmanager
def serving(*streams: StreamInfo, address: str = ANY, **options: Any) -> Iterator[DvServer]:
    server = DvServer(address, **options)
    server.open(streams or [ALL])
    try:
        yield server
    finally:
        server.close()


def came(server: DvServer, count: int, within_s: float = 20.0) -> None:
    """Until so many clients are there, in all."""
    deadline = time.monotonic() + within_s
    while sum(len(port.clients) for port in server._ports.values()) != count:
        assert time.monotonic() < deadline, "the clients did not come"
        server._serve_clients(0.05)
