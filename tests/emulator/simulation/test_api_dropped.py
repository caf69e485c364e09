"""What was dropped is gone at once: nothing waits for the garbage collector, and no page stays."""

from __future__ import annotations

import gc
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator.config import ModelConfig, RenderConfig, SensorConfig
from reference.memory import resident_bytes

pytestmark = pytest.mark.extremes

STAGE = """
<mujoco>
  <option timestep=".001"/>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="3 3 .1"/>
    <body pos="0 0 1">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom size=".1"/>
    </body>
  </worldbody>
  <actuator><motor joint="slide"/></actuator>
</mujoco>
"""
MODEL = mujoco.MjModel.from_xml_string(STAGE)
SIZE = SensorConfig("davis346", width=24, height=16)


def sensor(**more: object) -> None:
    data = mujoco.MjData(MODEL)
    one = evs.EventCamera(MODEL, sensor=SIZE, threads=2, **more)  # type: ignore[arg-type]
    for _ in range(2):
        one.observe(data)
        mujoco.mj_step(MODEL, data)


def world() -> None:
    one = evs.World(MODEL, control="random", threads=2)
    one.add_camera(sensor=SIZE)
    one.step()


def world_with_views() -> None:
    one = evs.World(MODEL, threads=2)
    view = one.add_view(sensor=SIZE, rgb=True)
    one.step()
    view.render()
    view.ground_truth()


def world_saved() -> None:
    one = evs.World(MODEL, threads=2)
    one.add_camera(sensor=SIZE)
    one.step()
    one.restore(one.save())


def loop() -> None:
    one = evs.ClosedLoop(MODEL, sensor=SIZE, limits={}, threads=2)
    one.reset()
    one.step([0.0])


WAYS: dict[str, Callable[[], None]] = {
    "sensor": sensor,
    "sensor, path": lambda: sensor(render=RenderConfig(renderer="path", spp=1)),
    "sensor, adaptive": lambda: sensor(model_config=ModelConfig(name="adaptive")),
    "sensor, evsnet": lambda: sensor(model_config=ModelConfig(name="evsnet")),
    "world": world,
    "world with views": world_with_views,
    "world that was saved": world_saved,
    "loop": loop,
}

CYCLES, STRETCHES = 60, 3
MOST_BYTES = 512 * CYCLES
"""A third of one image of 24 x 16 float32 a cycle: less than any array that would stay. What stays
grows in every stretch; the allocator, whose threads take arenas as they meet, only in some."""


@pytest.mark.parametrize("way", WAYS)
def test_nothing_waits_for_the_garbage_collector(way: str) -> None:
    WAYS[way]()
    gc.collect()
    gc.disable()
    try:
        WAYS[way]()
        assert gc.collect() == 0
    finally:
        gc.enable()


@pytest.mark.slow
def test_making_and_dropping_takes_no_memory() -> None:
    found = []
    for _ in range(STRETCHES + 1):
        for _ in range(CYCLES):
            loop()
        found.append(resident_bytes())
    assert min(np.diff(found)) < MOST_BYTES
