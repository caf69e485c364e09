"""A world that begins anew a million times."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from evs.emulator import World
from evs.emulator.config import SceneConfig, SensorConfig
from evs.tools.stress.grid_target import grid_mjcf, place
from evs.tools.stress.light.levels import USUAL
from evs.tools.stress.resident_memory import LEAST_BYTES, resident_bytes
from evs.tools.stress.stress_case import Measurement, StressCase

SIDE_PX = 2
LOOK = 1000
"""Each so-manyth reset is followed by ticks, of another seed."""

SEEDS = 5


def _resets(short: bool) -> Measurement:
    resets = 10_000 if short else 1_000_000
    with TemporaryDirectory() as name:
        scene = Path(name) / "scene.xml"
        scene.write_text(grid_mjcf(USUAL, SIDE_PX), encoding="utf-8")
        world = World(SceneConfig(file=str(scene)), threads=1)
        sensor = SensorConfig(
            preset="davis346", width=SIDE_PX, height=SIDE_PX, shot_noise_rate_hz=1000.0
        )
        world.add_camera(sensor=sensor)
        first = [_episode(world, seed) for seed in range(SEEDS)]
        wrong, resident = 0, 0
        for reset in range(resets):
            if reset % LOOK == 0:
                seed = reset // LOOK % SEEDS
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
    kept = last == first and growth <= most and varied
    return Measurement(wrong, 0, "episodes", messages, kept)


def _episode(world: World, seed: int) -> bytes:
    """Two ticks from the begin: the bytes of their packets' events and numbers."""
    world.reset(seed)
    payload = b""
    for tick in range(2):
        place(world, tick * SIDE_PX)
        (packet,) = world.step()
        payload += packet.events.tobytes() + bytes([packet.seq]) + b"%d" % packet.time_end_us
    return payload


CASES = (
    StressCase(
        "a-million-resets",
        "time",
        "1,000,000 resets of a world with a noisy camera, each 1000th with another seed and ticks",
        "the bytes of a new world's episode each time, stamps and numbers of packets from the "
        "begin; nothing is kept per reset (16 bytes would be seen)",
        _resets,
    ),
)
