"""Stress cases of time: ticks of any length, a day, streams that begin late, a million resets."""

from __future__ import annotations

import hashlib
import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from evs.drivers.bus import Publisher, subscribe
from evs.drivers.files import formats, messages, stream_of
from evs.drivers.run.run import run
from evs.emulator import EventCamera, World
from evs.emulator.base.stamps import MAX_START_US, later_events
from evs.emulator.config import SceneConfig, SensorConfig
from evs.emulator.world import MjData, load_model
from evs.msgs import EventPacket, Events, join_events
from evs_lab.stress.capture import capture
from evs_lab.stress.closed_form import counts
from evs_lab.stress.grid_target import FLASH_PX, HEIGHT_PX, grid_mjcf, place
from evs_lab.stress.light import USUAL
from evs_lab.stress.memory import LEAST_BYTES, resident_bytes
from evs_lab.stress.moving_edge import capture_edge, is_explained, worst_share
from evs_lab.stress.stress_case import Measurement, StressCase

TICKS_US = (10, 100, 1000, 10_000, 100_000)
SPEED_PX_S = 100.0


def _ticks(short: bool) -> Measurement:
    worst, recovered, messages = 0.0, True, []
    for tick_us in TICKS_US:
        width_px = 1 if short and tick_us == 10 else 4
        seen = capture_edge(SPEED_PX_S, tick_us, width_px)
        share = worst_share(seen, SPEED_PX_S, tick_us, width_px)
        worst, recovered = max(worst, share), recovered and is_explained(seen)
        messages.append(f"ticks of {tick_us} us: {share:.2f} of the bound")
        messages += seen.warnings
    return Measurement(worst, 1.0, "of the bound", tuple(messages), recovered)


DAY_TICK_US, HOUR_TICKS = 1_000_000, 3600
PERIOD = (*USUAL, 0.3)
"""light that comes again every 8 ticks, 450 times an hour"""

DAY_WIDTH_PX = 2
LATE_S = (86_400.0, 2**31 / 1e6, 2**32 / 1e6, 1_795_305_600.0)
"""a day; the ends of int32 and uint32 in us; a Unix time"""


def _small_sensor(width_px: int) -> SensorConfig:
    return SensorConfig(preset="ideal", width=width_px, height=HEIGHT_PX)


class _HourlyDigest:
    """Observer of a run: for each hour a digest of its events, their number, and the memory."""

    def __init__(self) -> None:
        self.digests: list[str] = []
        self.events: list[int] = []
        self.resident: list[int] = []
        self._begin()

    def _begin(self) -> None:
        self._sum, self._count = hashlib.sha256(), 0

    def __call__(self, tick: int, world: Any, packets: tuple[EventPacket, ...]) -> None:
        """Observer of the run."""
        hour_us = len(self.digests) * HOUR_TICKS * DAY_TICK_US
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
        world = World(SceneConfig(file=str(scene), tick_us=DAY_TICK_US), threads=1)
        world.add_camera(sensor=_small_sensor(DAY_WIDTH_PX))
        place(world, 0)
        seen = _HourlyDigest()
        report = run(world, [], hours * HOUR_TICKS * DAY_TICK_US / 1e6, observers=[seen])
        late = sum(_late(scene, begin_s) for begin_s in LATE_S)
    # the first hour has another past: its first tick
    other = sum(digest != seen.digests[1] for digest in seen.digests[2:])
    levels = np.array([*PERIOD] * 2, np.float64)[:, None, None]
    expected, _ = counts(np.broadcast_to(levels, (len(levels), HEIGHT_PX, DAY_WIDTH_PX)))
    period = expected[len(PERIOD) :].sum()
    count_error = abs(seen.events[-1] - period * HOUR_TICKS / len(PERIOD))
    # an object stored in each tick would be this much
    growth = seen.resident[-1] - seen.resident[1]
    most = LEAST_BYTES * HOUR_TICKS * (hours - 2) + 2**18
    messages = (
        *report.warnings,
        f"{report.sim_seconds / 3600:g} h, {report.events:,} events, the last at {world.t_us} us",
        f"memory grew by {growth / 1024:.0f} KiB",
    )
    steady = growth <= most and world.t_us == hours * HOUR_TICKS * DAY_TICK_US
    return Measurement(other + count_error + late, 0, "wrong hours or events", messages, steady)


def _late(scene: Path, begin_s: float) -> int:
    """Count the events of one motion that differ when its clock begins later: 0."""
    first, late = _observed(scene, 0.0), _observed(scene, begin_s)
    late["t"] -= round(begin_s * 1e6)
    return len(np.setxor1d(first, late)) + (len(first) == 0)


def _observed(scene: Path, begin_s: float) -> Events:
    """Events of an EventCamera in a caller's own loop, whose clock begins at `begin_s`."""
    model = load_model(scene)
    sensor, data = (
        EventCamera(model, "eye", sensor=_small_sensor(FLASH_PX), threads=1),
        MjData(model),
    )
    parts = []
    for tick in range(40):
        data.mocap_pos[0] = (-FLASH_PX / 2 - tick % len(PERIOD) * FLASH_PX, 0, 0)
        data.time = begin_s + tick * 1e-3
        parts.append(sensor.observe(data))
    return join_events(parts)


UNIX_US = 1_795_305_600_000_000
"""22 November 2026 as a Unix time"""

STARTS_US = (2**31 - 4000, 2**31, 2**32 - 4000, UNIX_US, MAX_START_US)
"""Two of them pass the ends of int32 and of uint32 in the middle of the run."""

LEVELS = (*USUAL, *USUAL)


def _capture_from(start_us: int, suffix: str, folder: Path | None = None) -> Events:
    """Events of the camera; `capture` has found the same in the recording."""

    def act(tick: int, world: World) -> None:
        place(world, min(tick, len(LEVELS) - 1) * FLASH_PX)

    seen = capture(
        grid_mjcf(LEVELS, FLASH_PX),
        len(LEVELS) * 1e-3,
        {
            "sensor": {"width": FLASH_PX, "height": HEIGHT_PX},
            "scene": {"start_us": start_us},
        },
        act,
        suffix,
        folder=folder,
    )
    return seen.events


QUEUE = 1 << 20
"""packets that may wait: the player is not paced, and the listener of a busy machine is slow"""


class _Listener:
    """A subscriber in a thread of its own."""

    def __init__(self, address: str) -> None:
        self.received: list[Events] = []
        self.lost = -1
        self._address = address
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        with subscribe(self._address, timeout_s=20.0, queue=QUEUE) as subscription:
            self.received += [packet.events for packet in subscription]
            self.lost = subscription.lost

    def events(self) -> Events:
        """All events until the publisher closes."""
        self._thread.join(timeout=30.0)
        return join_events(self.received)


def _played(file: Path) -> tuple[Events, int]:
    """Play a recording on the bus: the events that a subscriber receives, and its lost packets."""
    # not a port, which another program could take first
    address = f"ipc://{file.with_name('bus')}"
    listener = _Listener(address)
    publisher = Publisher(address, wait_for=1, queue=QUEUE)
    try:
        publisher.open([stream_of(file)])
        for message in messages(file):
            if isinstance(message, EventPacket):
                publisher.write(message)
    finally:
        publisher.close()
    return listener.events(), listener.lost


def _starts(short: bool) -> Measurement:
    kinds = [kind for kind in formats.RECORDED if not kind.extra]
    if short:
        kinds = [kind for kind in kinds if kind.name in ("aedat4", "aedat2", "evt3", "npz")]
    usual = _capture_from(0, ".aedat4")
    wrong, notes = 0, []
    for start_us in (STARTS_US[0], UNIX_US) if short else STARTS_US:
        expected = later_events(usual, start_us)
        for kind in kinds:
            wrong += len(np.setxor1d(_capture_from(start_us, kind.suffixes[0]), expected))
        with TemporaryDirectory() as name:
            _capture_from(start_us, ".aedat4", Path(name))
            received, lost = _played(Path(name) / "run.aedat4")
        missing = len(np.setxor1d(received, expected)) + abs(lost)
        wrong += missing
        if missing:
            notes.append(f"from {start_us} us on the bus: {len(received)} events, lost {lost}")
    again = _capture_from(0, ".aedat4")
    return Measurement(wrong, 0, "wrong events", tuple(notes), np.array_equal(again, usual))


RESET_PX = 2
CHECK_EVERY = 1000
"""Each reset of this number has a new seed and is followed by ticks."""

SEEDS = 5


def _resets(short: bool) -> Measurement:
    resets = 10_000 if short else 1_000_000
    with TemporaryDirectory() as name:
        scene = Path(name) / "scene.xml"
        scene.write_text(grid_mjcf(USUAL, RESET_PX), encoding="utf-8")
        world = World(SceneConfig(file=str(scene)), threads=1)
        sensor = SensorConfig(
            preset="davis346", width=RESET_PX, height=RESET_PX, shot_noise_rate_hz=1000.0
        )
        world.add_camera(sensor=sensor)
        first = [_episode(world, seed) for seed in range(SEEDS)]
        wrong, resident = 0, 0
        for reset in range(resets):
            if reset % CHECK_EVERY == 0:
                seed = reset // CHECK_EVERY % SEEDS
                wrong += _episode(world, seed) != first[seed]
            else:
                world.reset()
            if reset == resets // 10:
                resident = resident_bytes()
        growth = resident_bytes() - resident
        last = [_episode(world, seed) for seed in range(SEEDS)]
    messages = (f"{resets:,} resets", f"memory grew by {growth / 1024:.0f} KiB")
    most = LEAST_BYTES * resets * 9 // 10 if not short else 2**20
    varied = len(set(first)) == SEEDS and all(len(events) > 0 for events in first)
    steady = last == first and growth <= most and varied
    return Measurement(wrong, 0, "wrong episodes", messages, steady)


def _episode(world: World, seed: int) -> bytes:
    """Run two ticks from the begin; the bytes of their packets' events and numbers."""
    world.reset(seed)
    payload = b""
    for tick in range(2):
        place(world, tick * RESET_PX)
        (packet,) = world.step()
        payload += packet.events.tobytes() + bytes([packet.seq]) + b"%d" % packet.time_end_us
    return payload


CASES = (
    StressCase(
        "tick-lengths",
        "time",
        "an edge that moves at 100 px/s, in ticks of 10 us, 100 us, 1 ms, 10 ms and 100 ms",
        "the same 8 events per pixel, each at its closed-form time to within a tick plus the time "
        "in which the edge moves 1/64 of a pixel",
        _ticks,
    ),
    StressCase(
        "a-day",
        "time",
        "24 h of simulated time in ticks of 1 s; an EventCamera whose clock starts at 1 day, "
        "2^31 us, 2^32 us and a Unix time",
        "from the second hour on, every hour has the same bytes, and as many events as the closed "
        "form; no memory is leaked (16 bytes per tick would be detected); a late clock changes "
        "only the timestamps",
        _day,
    ),
    StressCase(
        "start-times",
        "time",
        "scene.start_us of 2^31 us, 2^32 us, a Unix time and the year 2112, recorded in every "
        "format and played back over the bus",
        "the same events, later by exactly scene.start_us",
        _starts,
    ),
    StressCase(
        "a-million-resets",
        "time",
        "1,000,000 resets of a world with a noisy camera; every 1000th takes a different seed and "
        "is followed by two ticks",
        "the same bytes each time as in an episode of a new world, with timestamps and packet "
        "numbers from the beginning; no memory is leaked (16 bytes per reset would be detected)",
        _resets,
    ),
)
