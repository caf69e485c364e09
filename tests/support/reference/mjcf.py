"""Scenes in MJCF that several tests use."""

BAR = """
<mujoco><worldbody><light pos="0 -1 3" dir="0 .3 -1"/>
<camera name="eye" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
<geom type="plane" size="2 2 .1" rgba=".8 .8 .8 1"/>
<body pos="0 0 .5"><joint name="spin" axis="0 1 0"/>
<geom type="box" size=".5 .05 .05" rgba=".1 .2 .9 1"/></body></worldbody>
<keyframe><key name="fast" qpos="0" qvel="{speed}"/></keyframe></mujoco>
"""
"""A blue bar that spins in the keyframe `fast`, at any speed in rad/s."""

ARM = """
<mujoco>
  <option timestep=".0005"/>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 1" rgba=".3 .3 .3 1"/>
    <camera name="side" pos="0 -3 1" xyaxes="1 0 0 0 .3 1"/>
    <camera name="top" pos="0 0 4"/>
    <body name="arm" pos="0 0 1"><joint name="swing" axis="0 1 0" damping="1"/>
      <geom type="capsule" fromto="0 0 0 .8 0 0" size=".15" density="50"/></body>
  </worldbody>
  <actuator><motor joint="swing" gear="400" ctrlrange="-1 1"/></actuator>
  <keyframe><key name="up" qpos="-1.2" ctrl=".7"/></keyframe>
</mujoco>
"""
"""An arm with a motor, before two cameras."""

BALL = """
<mujoco model="ball">
  <visual><headlight ambient="0.3 0.3 0.3"/></visual>
  <worldbody>
    <light pos="1 -1 4"/>
    <geom name="floor" type="plane" size="5 5 .1" rgba=".4 .4 .4 1"/>
    <body name="ball" pos="0 0 1.2"><freejoint/>
      <geom name="ball" size=".4" rgba=".9 .8 .2 1"/></body>
    <body pos="0 -3 1" gravcomp="1"><joint name="x" type="slide" axis="1 0 0"/>
      <geom size=".01" mass="1" rgba="0 0 0 0"/><camera name="eye" xyaxes="1 0 0 0 0 1"/></body>
  </worldbody>
  <actuator><velocity name="x" joint="x" kv="100" ctrlrange="-2 2"/></actuator>
</mujoco>
"""
"""A ball that falls, before a camera that slides."""
