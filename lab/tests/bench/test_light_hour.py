"""An hour of simulated time, 3.6 million ticks of a small camera: memory stays where it was.

It takes a quarter of an hour, so `make bench` leaves it out. The figure in
docs/explanation/guarantees.md is from
`.venv/bin/pytest -m bench -s lab/tests/bench/test_light_hour.py`.
"""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from evs.emulator import World
from evs.emulator.config import SensorConfig
from reference.memory import resident_bytes

MINUTE, HOUR = 60_000, 3_600_000


@pytest.mark.bench
@pytest.mark.slow
def test_an_hour_of_an_ant(robot_files: dict[str, Path]) -> None:
    world = World(robot_files["gymnasium/ant"], control="random")
    world.add_camera(sensor=SensorConfig("davis346", width=32, height=24))
    began, events, after = time.perf_counter(), 0, {}
    for tick, (packet,) in enumerate(world.run(HOUR / 1000), 1):
        events += len(packet.events)
        if tick % (10 * MINUTE) == 0 or tick == MINUTE:
            after[tick] = resident_bytes()
            print(
                f"\n  {tick / MINUTE:3.0f} min simulated, {time.perf_counter() - began:6.0f} s, "
                f"{after[tick] / 2**20:.1f} MiB, {events} events",
                end="",
            )
    assert events > HOUR
    # one piece of 16 bytes in a hundred ticks would be over this
    assert after[HOUR] - after[MINUTE] < 2**19
