"""What the tests of worker sinks share: packets of a small camera, and patience."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from evs.drivers.run.config import make_sink
from evs.drivers.run.sink_set import SinkSet
from evs.drivers.run.worker import WorkerSink
from evs.drivers.sink import Sink
from evs.drivers.sink_config import SinkConfig
from evs.emulator.base.protocols import NoMeter
from evs.msgs import LABEL_DTYPE, EventPacket, Frame, ImuPacket, StreamInfo, empty_imu, make_events

WIDTH, HEIGHT = 40, 30
INFO = StreamInfo(WIDTH, HEIGHT, "eye", config={"scene": {"file": "a.xml"}, "spans": [1.5, None]})
EVENTS = 300


def packet(seq: int, events: int = EVENTS, *, labels: bool = False) -> EventPacket:
    """Of one tick, other events each time."""
    random = np.random.default_rng(seq)
    t = np.sort(random.integers(1, 1001, events)) + 1000 * seq
    x, y, p = (random.integers(0, side, events) for side in (WIDTH, HEIGHT, 2))
    causes = np.zeros(events, LABEL_DTYPE)
    causes["cause"], causes["geom_id"] = x % 5, y
    span = 1000 * seq, 1000 * seq + 1000
    body = make_events(t, x, y, p)
    return EventPacket(seq, *span, WIDTH, HEIGHT, body, "eye", causes if labels else None)


class Camera:
    """What the sinks take from a camera with everything."""

    pose = None

    def __init__(self, info: StreamInfo, seq: int) -> None:
        self.info = info
        t = 1000 * seq
        pixels = np.full((HEIGHT, WIDTH), seq % 256, np.uint8)
        self.frames = [Frame(seq, t, t + 10, t + 20, t + 30, pixels, "eye")] if info.frames else []
        samples = empty_imu(2)
        samples["t"] = t + 100, t + 600
        samples["acceleration"] = seq, 1.0, 9.8
        self.imu_packet = ImuPacket(seq, samples, "eye") if info.imu else None


def worker_sink(**given: Any) -> WorkerSink:
    sink = make_sink(SinkConfig.of(worker=True, **given))
    assert isinstance(sink, WorkerSink)
    return sink


def feed(sinks: Sequence[Sink], info: StreamInfo, ticks: int, *, labels: bool = False) -> SinkSet:
    """A short run; its sink set, closed."""
    sink_set = SinkSet(sinks, NoMeter(), lambda _: None)
    sink_set.open([info])
    for seq in range(ticks):
        sink_set.write_auxiliary([Camera(info, seq)], 1000 * seq + 1000)
        sink_set.write([packet(seq, EVENTS * (seq % 4), labels=labels)])
    failure = sink_set.close()
    assert failure is None
    return sink_set


def write_on(sink: Sink, first: int, events: int = EVENTS) -> None:
    """Packet after packet, until an error."""
    for seq in range(first, 100_000):
        sink.write(packet(seq, events))


def is_there(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def soon(what: Any, seconds: float = 20.0) -> None:
    """Wait for it."""
    until = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < until, "it never came"
        time.sleep(0.005)
