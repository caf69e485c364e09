"""Every robot that gymnasium and dm_control ship goes through the whole emulator."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator import World
from evs.emulator.config import SensorConfig

pytestmark = [pytest.mark.integration, pytest.mark.slow]

QUIET = SensorConfig(
    leak_rate_hz=0.0, photocurrent_pa=0.0, hot_leak_median_hz=0.0, parasitic_leak_hz=0.0
)


def test_every_shipped_robot_runs_and_none_is_black(robot_files):
    still = set()
    for name, path in robot_files.items():
        world = World(path, control="random")
        # the default sensor, but events come from light alone
        camera = world.add_camera(sensor=QUIET)
        packets = [packet for (packet,) in world.run(0.05)]
        assert [packet.time_end_us for packet in packets] == list(range(1000, 51_000, 1000)), name
        picture = camera.luminance
        assert picture.shape == (260, 346), name
        assert np.isfinite(picture).all(), name
        assert (picture >= 0).all(), name
        assert not camera.is_dark, name
        # a picture, not one grey
        assert picture.std() > 1e-3, name
        assert camera.clamps == 0, name
        if not camera.events:
            still.add(name)
    # without joints or actuators; and two slow ones that have hardly moved by then
    asleep = {"dm_control/lqr", "dm_control/swimmer"}
    slow = {"dm_control/point_mass", "gymnasium/point"}
    assert asleep <= still <= asleep | slow


def test_a_robot_gives_the_same_bytes_twice_on_any_number_of_threads(robot_files):
    def stream(threads):
        world = World(robot_files["gymnasium/humanoid"], control="random", seed=5, threads=threads)
        world.add_camera("track")
        return b"".join(packet.events.tobytes() for (packet,) in world.run(0.05))

    first = stream(1)
    assert len(first) > 16 * 10_000
    assert stream(1) == first
    assert stream(2) == first
