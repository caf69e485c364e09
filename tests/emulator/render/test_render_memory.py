"""The way of the light, pose to events, keeps nothing from tick to tick: no object and no block.

That the native core allocates nothing, tests/emulator/core/allocation_test.cpp shows.
"""

from __future__ import annotations

import ctypes
import gc
import tracemalloc

import mujoco
import numpy as np
import pytest

from evs.emulator import EventCamera
from evs.emulator.config import FlickerConfig, RenderConfig, SensorConfig
from reference.memory import LEAST_BYTES

pytestmark = pytest.mark.extremes

STAGE = """
<mujoco>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".2 .2 .2" rgb2=".9 .9 .9" width="64"
      height="64"/>
    <material name="tiles" texture="tiles" texrepeat="4 4" reflectance=".2"/>
  </asset>
  <worldbody>
    <camera name="tilted" pos="0 -3 1.5" xyaxes="1 0 0 0 .45 .9"/>
    <light name="lamp" pos="1 -1 3" dir="-.3 .3 -1" bulbradius=".1"/>
    <geom type="plane" size="3 3 .1" material="tiles"/>
    <body mocap="true" pos="0 0 .5">
      <geom type="capsule" size=".1 .3"/>
      <geom type="box" size=".2 .1 .1" pos=".4 0 0"/>
    </body>
    {more}
  </worldbody>
</mujoco>
"""
CLOTH = """<flexcomp name="cloth" type="grid" count="4 4 1" spacing=".2 .2 .2" radius=".01" dim="2"
  pos="-.5 .5 .6" mass="1"><edge equality="true"/></flexcomp>"""
WAYS = {
    "direct, adaptive": ("", RenderConfig(antialiasing="adaptive")),
    "direct, fixed, traced whole": ("", RenderConfig(antialiasing="fixed", incremental=False)),
    "direct, a cloth": (CLOTH, RenderConfig(spp=1)),
    "direct, flicker": ("", RenderConfig(spp=1, flicker=(FlickerConfig(light="lamp", hz=50.0),))),
    "path": ("", RenderConfig(renderer="path", spp=1)),
    "path, fresh": ("", RenderConfig(renderer="path", spp=1, seeds="fresh")),
}


class Life:
    """A sensor of 24 x 16 px over a stage where something moves in each tick."""

    def __init__(self, way: str) -> None:
        more, render = WAYS[way]
        self.model = mujoco.MjModel.from_xml_string(STAGE.format(more=more))
        self.data = mujoco.MjData(self.model)
        pixels = SensorConfig("ideal", width=24, height=16)
        self.sensor = EventCamera(self.model, "tilted", sensor=pixels, render=render, threads=2)
        self.tick, self.events = 0, 0

    def go_on(self, ticks: int) -> None:
        """See that many ms."""
        for _ in range(ticks):
            self.tick += 1
            angle = 2 * np.pi * self.tick / 500
            self.data.time = self.tick * 1e-3
            self.data.mocap_pos[0] = (0.3 * np.sin(angle), 0.2 * np.cos(angle), 0.5)
            # a cloth that swings; without one there is nothing to set
            self.data.qpos[:] = 0.05 * np.sin(angle + np.arange(self.model.nq))
            self.events += len(self.sensor.observe(self.data))


class Mallinfo(ctypes.Structure):
    """What glibc's mallinfo2 returns."""

    _fields_ = tuple((name, ctypes.c_size_t) for name in (*"0123", "mapped", *"56", "used", *"89"))


def in_use() -> tuple[int, int]:
    """Bytes of Python's objects, and bytes that malloc gave away, after a garbage collection."""
    gc.collect()
    mallinfo = ctypes.CDLL(None).mallinfo2
    mallinfo.restype = Mallinfo
    native = mallinfo()
    return tracemalloc.get_traced_memory()[0], native.used + native.mapped


@pytest.mark.parametrize("way", WAYS)
def test_no_object_and_no_block_stays_behind(way: str) -> None:
    life, ticks = Life(way), 1_000
    life.go_on(500)
    tracemalloc.start()
    try:
        # the first periods under its eyes: what is replaced in each tick is counted from here on
        life.go_on(500)
        before = in_use()
        life.go_on(ticks)
        grown = np.subtract(in_use(), before)
    finally:
        tracemalloc.stop()
    assert life.events > ticks
    assert (grown < LEAST_BYTES * ticks).all()
