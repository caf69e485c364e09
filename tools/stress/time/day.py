"""A day of stream time, and clocks that begin late."""

from __future__ import annotations

import hashlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from evs.drivers.run.run import run
from evs.emulator import Sensor, World
from evs.emulator.base.stamps import later_events
from evs.emulator.config import SceneConfig, SensorConfig
from evs.emulator.world import MjData, load_model
from evs.msgs import EventPacket, Events, join_events
from evs.tools.stress.closed_form import counts
from evs.tools.stress.grid_target import FLASH_PX, HEIGHT_PX, grid_mjcf, place
from evs.tools.stress.light.levels import USUAL
from evs.tools.stress.resident_memory import LEAST_BYTES, resident_bytes
from evs.tools.stress.stress_case import Measurement, StressCase

TICK_US, HOUR_TICKS = 1_000_000, 3600
PERIOD = (*USUAL, 0.3)
"""light that comes again every 8 ticks, 450 times an hour"""

WIDTH_PX = 2
LATE_S = (86_400.0, 2**31 / 1e6, 2**32 / 1e6, 1_795_305_600.0)
"""a day; the ends of int32 and uint32 in us; a Unix time"""


def _small_sensor(width_px: int) -> SensorConfig:
    return SensorConfig(preset="ideal", width=width_px, height=HEIGHT_PX)


class _HourlyDigest:
    """What a run loop tells of each hour: a digest of its events, how many; and memory."""

    def __init__(self) -> None:
        self.digests: list[str] = []
        self.events: list[int] = []
        self.resident: list[int] = []
        self._begin()

    def _begin(self) -> None:
        self._sum, self._count = hashlib.sha256(), 0

    def __call__(self, tick: int, world: Any, packets: tuple[EventPacket, ...]) -> None:
        """Observer of the run."""
        hour_us = len(self.digests) * HOUR_TICKS * TICK_US
        for packet in packets:
            events = later_events(packet.events, -hour_us)
            self._sum.update(events.tobytes())
            self._count += len(events)
        if tick % HOUR_TICKS == 0:
            self.digests.append(self._sum.hexdigest())
            self.events.append(self._count)
            self.resident.append(resident_bytes())
            self._begin()
        place(world, tick % len(PERIOD) * FLASH_PX)


def _day(short: bool) -> Measurement:
    hours = 3 if short else 24
    with TemporaryDirectory() as name:
        scene = Path(name) / "scene.xml"
        scene.write_text(grid_mjcf(PERIOD, FLASH_PX), encoding="utf-8")
        world = World(SceneConfig(file=str(scene), tick_us=TICK_US), threads=1)
        world.add_camera(sensor=_small_sensor(WIDTH_PX))
        place(world, 0)
        seen = _HourlyDigest()
        report = run(world, [], hours * HOUR_TICKS * TICK_US / 1e6, observers=[seen])
        late = sum(_late(scene, begin_s) for begin_s in LATE_S)
    # the first hour has another past: its first tick
    other = sum(digest != seen.digests[1] for digest in seen.digests[2:])
    levels = np.array([*PERIOD] * 2, np.float64)[:, None, None]
    expected, _ = counts(np.broadcast_to(levels, (len(levels), HEIGHT_PX, WIDTH_PX)))
    period = expected[len(PERIOD) :].sum()
    count_error = abs(seen.events[-1] - period * HOUR_TICKS / len(PERIOD))
    # an object kept in each tick would be this much
    growth = seen.resident[-1] - seen.resident[1]
    most = LEAST_BYTES * HOUR_TICKS * (hours - 2) + 2**18
    messages = (
        *report.warnings,
        f"{report.sim_seconds / 3600:g} h, {report.events:,} events, the last at {world.t_us} us",
        f"memory grew by {growth / 1024:.0f} KiB",
    )
    kept = growth <= most and world.t_us == hours * HOUR_TICKS * TICK_US
    return Measurement(other + count_error + late, 0, "hours or events", messages, kept)


def _late(scene: Path, begin_s: float) -> int:
    """Events of the same motion at the two times that are not the same: 0."""
    first, late = _observed(scene, 0.0), _observed(scene, begin_s)
    late["t"] -= round(begin_s * 1e6)
    return len(np.setxor1d(first, late)) + (len(first) == 0)


def _observed(scene: Path, begin_s: float) -> Events:
    """What a Sensor in somebody else's loop says, whose clock begins at `begin_s`."""
    model = load_model(scene)
    sensor, data = Sensor(model, "eye", sensor=_small_sensor(FLASH_PX), threads=1), MjData(model)
    parts = []
    for tick in range(40):
        data.mocap_pos[0] = (-FLASH_PX / 2 - tick % len(PERIOD) * FLASH_PX, 0, 0)
        data.time = begin_s + tick * 1e-3
        parts.append(sensor.observe(data))
    return join_events(parts)


CASES = (
    StressCase(
        "a-day",
        "time",
        "24 h of stream time in a run loop (ticks of 1 s); a Sensor whose clock begins a day late, "
        "at 2^31 us, 2^32 us and a Unix time",
        "every hour has the bytes of the second, and as many events as the closed form; nothing is "
        "kept per tick (16 bytes would be seen); late clocks change the stamps alone",
        _day,
    ),
)
