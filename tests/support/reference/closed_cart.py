"""A cart with a pole, two cameras and three sensors, for tests of the closed loop."""

from __future__ import annotations

import numpy as np

from evs.emulator import ClosedLoop
from evs.emulator.config import SensorConfig

SMALL = SensorConfig(preset="dvs128", width=40, height=32)
CART = """
<mujoco>
  <option timestep=".001"/>
  <worldbody>
    <light pos="0 -1 3"/>
    <geom type="plane" size="3 3 1" rgba=".3 .3 .3 1"/>
    <camera name="left" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
    <camera name="right" pos="2 0 .6" xyaxes="0 1 0 -.2 0 1"/>
    <body name="cart" pos="0 0 .2"><joint name="slide" type="slide" axis="1 0 0" damping=".5"/>
      <geom type="box" size=".15 .1 .05" rgba=".8 .3 .2 1" mass=".5"/>
      <body pos="0 0 .05"><joint name="tilt" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 .6" size=".03" rgba=".9 .9 .9 1" mass=".1"/>
      </body></body>
  </worldbody>
  <actuator><motor joint="slide" gear="10"/><position joint="tilt" kp="0"/></actuator>
  <sensor><jointpos name="tilt" joint="tilt"/><jointvel name="speed" joint="slide"/>
    <touch name="bump" site="tip"/></sensor>
  <keyframe><key name="leaning" qpos="0 .2"/></keyframe>
</mujoco>
""".replace('size=".03" rgba', 'size=".03" name="pole" rgba').replace(
    "      </body></body>", '<site name="tip" pos="0 0 .6" size=".05"/></body></body>'
)


def make(cart, **options):
    return ClosedLoop(cart, cameras=("left", "right"), sensor=SMALL, **options)


def drive(loop, decisions, seed=3, **options):
    """Every observation of an episode under these controls."""
    seen = [loop.reset(seed=seed, **options)]
    for ctrl in decisions:
        seen.append(loop.step(ctrl))
    return seen


def wave(ticks):
    return [(np.sin(tick / 7), 0.0) for tick in range(ticks)]
