"""A recording of 3,000 events in 40 packets, as any format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers import files
from evs.msgs import EventPacket, Events, Frame, ImuPacket, StreamInfo, empty_imu, make_events

STREAM = StreamInfo(346, 260, camera="eye", sensor="davis346", seed=9, config={"a": [1]})


def events() -> Events:
    random = np.random.default_rng(4)
    t = np.sort(random.integers(1, 40_001, 3000))
    x, y = random.integers(0, 346, 3000), random.integers(0, 260, 3000)
    return make_events(t, x, y, random.integers(0, 2, 3000))


def record(path: Path, kind: str, beside: bool = False) -> Path:
    """Write it; `beside`: with a frame and four IMU samples."""
    sink: Any = files.recorder_for(path, kind=kind)
    sink.open([replace(STREAM, frames=beside, imu=beside)])
    if beside:
        sink.write_frame(Frame(0, 0, 1, 2, 3, np.ones((260, 346), np.uint8), "eye"))
        samples = empty_imu(4)
        samples["t"] = 5
        sink.write_imu(ImuPacket(0, samples, "eye"))
    every = events()
    ticks = -(-every["t"] // 1000)
    for seq, part in enumerate(np.split(every, np.flatnonzero(np.diff(ticks)) + 1)):
        sink.write(EventPacket(seq, 0, 0, 346, 260, part, "eye"))
    sink.close()
    return path
