"""A post and a ball that can slide, in soft light, seen by a camera that stands still."""

from __future__ import annotations

import mujoco

from evs.emulator import World
from evs.emulator.config import RenderConfig, SensorConfig

ROOM = """
<mujoco>
  <option timestep=".001" gravity="0 0 0"/>
  <worldbody>
    <light pos="0 -1 3" bulbradius=".4"/>
    <geom type="plane" size="3 3 1" rgba=".6 .6 .6 1"/>
    <geom name="post" type="box" size=".1 .1 .5" pos="0 0 .5" rgba=".8 .3 .2 1"/>
    <body name="ball" pos=".5 .2 .6"><joint name="x" type="slide" axis="1 0 0"/>
      <geom size=".15" rgba=".2 .7 .3 1"/></body>
    <camera name="eye" pos="0 -3 1" xyaxes="1 0 0 0 .3 1"/>
    <camera name="other" pos="0 -2 1" xyaxes="1 0 0 0 .3 1"/>
  </worldbody>
</mujoco>
"""
SENSOR = SensorConfig("ideal", width=48, height=36)


def ball_room(render: RenderConfig, cameras: tuple[str, ...] = ("eye",)) -> World:
    """A world of the room with some of its cameras, on one thread."""
    world = World(mujoco.MjModel.from_xml_string(ROOM), threads=1)
    for name in cameras:
        world.add_camera(name, sensor=SENSOR, render=render)
    return world
