"""What it costs to see in every tick whether a model was edited: CPU time of one thread."""

from __future__ import annotations

import statistics
import time

import mujoco
import pytest

from evs.emulator.world import LiveScene

pytestmark = pytest.mark.bench

MOST_US = 5.0
"""for 100 geoms"""


def look_us(geoms: int) -> float:
    """Microseconds of one look at a model of so many geoms, each with a material; median."""
    assets = "".join(f'<material name="m{i}"/>' for i in range(geoms))
    bodies = "".join(f'<geom size=".1" pos="{i} 0 0" material="m{i}"/>' for i in range(geoms))
    scene = LiveScene(
        mujoco.MjModel.from_xml_string(
            f"<mujoco><asset>{assets}</asset><worldbody>{bodies}</worldbody></mujoco>"
        )
    )
    found = []
    for _ in range(50):
        begin_ns = time.process_time_ns()
        for _ in range(1000):
            scene.outdated()
        found.append((time.process_time_ns() - begin_ns) / 1e6)
    return statistics.median(found)


def test_a_look_for_edits() -> None:
    found = {geoms: look_us(geoms) for geoms in (1, 100, 1000, 4000)}
    print("\ngeoms   us a look")
    for geoms, us in found.items():
        print(f"{geoms:5}   {us:.2f}")
    assert found[100] < MOST_US
    # linear: four times as many are no more than five times as much
    assert found[4000] < 5.0 * found[1000]
