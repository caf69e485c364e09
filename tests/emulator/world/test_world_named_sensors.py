"""Sensors by name: of this very instant, those that have a name, and some for who has none."""

from __future__ import annotations

import copy
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator.world import NamedSensors, add_joint_sensors, load_model, load_spec
from evs.msgs import EvsError

MODEL = """
<mujoco>
  <worldbody><body name="arm">
    <joint name="turn" axis="0 1 0"/><joint name="slip" type="slide" axis="1 0 0"/>
    <geom size=".1" pos="0 0 .5" mass="2"/><site name="tip" pos="0 0 1"/>
  </body></worldbody>
  <sensor>
    <jointpos name="angle" joint="turn"/><jointvel joint="turn"/>
    <framepos name="tip" objtype="site" objname="tip"/>
    <accelerometer name="felt" site="tip"/>
  </sensor>
</mujoco>
"""


def test_they_belong_to_the_instant_and_touch_nothing() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3, 0.1
    for _ in range(20):
        mujoco.mj_step(model, data)
    before = data.sensordata.copy()
    told = NamedSensors(model).read(data)
    # the nameless one is left out
    assert list(told) == ["angle", "tip", "felt"]
    assert np.array_equal(before, data.sensordata)
    # after mj_step the data's own sensors are a step old
    assert told["angle"][0] == data.qpos[0] != data.sensordata[0]
    turn, slip = data.qpos
    place = [slip * np.cos(turn) + np.sin(turn), 0.0, -slip * np.sin(turn) + np.cos(turn)]
    assert told["tip"] == pytest.approx(place, abs=1e-12)
    fresh = mujoco.MjData(model)
    fresh.qpos[:], fresh.qvel[:] = data.qpos, data.qvel
    fresh.qacc_warmstart[:] = data.qacc_warmstart
    mujoco.mj_forward(model, fresh)
    assert told["felt"] == pytest.approx(fresh.sensor("felt").data, abs=1e-9)
    # what is given out is the receiver's own
    told["angle"][0] = 7.0
    assert NamedSensors(model, ["angle"]).read(data)["angle"][0] == data.qpos[0]


def test_one_that_is_not_there_is_named() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert NamedSensors(model, ["tip", "angle"]).names == ("tip", "angle")
    with pytest.raises(EvsError, match="no sensor 'angel'; there is: angle"):
        NamedSensors(model, ["angel"])


def test_a_stock_robot_can_be_given_some(robot_files: dict[str, Path]) -> None:
    spec = load_spec(robot_files["gymnasium/inverted_pendulum"])
    add_joint_sensors(spec, {"angle": "hinge", "place": "slider"})
    model = load_model(spec)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.2, -0.1
    told = NamedSensors(model).read(data)
    assert (told["angle"][0], told["place"][0]) == (-0.1, 0.2)
    with pytest.raises(EvsError, match="no joint 'hing'; there is: hinge, slider"):
        add_joint_sensors(spec, {"angle": "hing"})


KINDS = """
<mujoco>
  <worldbody>
    <geom type="plane" size="3 3 1"/>
    <site name="world"/>
    <camera name="eye" pos="0 -2 1" xyaxes="1 0 0 0 0 1"/>
    <body name="arm" pos="0 0 1"><joint name="h" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/><site name="s" pos=".3 0 0"/>
      <body name="hand" pos=".3 0 0"><joint name="j" axis="0 1 0" range="-20 20"/>
        <geom name="tip" type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
      </body></body>
    <body name="ball" pos="0 1 .09"><freejoint/><geom name="g" size=".1"/></body>
  </worldbody>
  <tendon><fixed name="t" limited="true" range="-.1 .1">
    <joint joint="h" coef="1"/><joint joint="j" coef="1"/></fixed></tendon>
  <actuator><motor name="m" joint="h"/></actuator>
  <sensor>
    <e_kinetic/><e_potential/><clock/>
    <jointpos joint="j"/><jointvel joint="j"/><jointactuatorfrc joint="h"/>
    <jointlimitpos joint="j"/><jointlimitvel joint="j"/><jointlimitfrc joint="j"/>
    <tendonpos tendon="t"/><tendonvel tendon="t"/>
    <tendonlimitpos tendon="t"/><tendonlimitvel tendon="t"/><tendonlimitfrc tendon="t"/>
    <actuatorpos actuator="m"/><actuatorvel actuator="m"/><actuatorfrc actuator="m"/>
    <subtreecom body="arm"/><subtreelinvel body="arm"/><subtreeangmom body="arm"/>
    <framepos objtype="body" objname="hand"/><framequat objtype="body" objname="hand"/>
    <framelinvel objtype="body" objname="hand"/><frameangvel objtype="body" objname="hand"/>
    <framelinacc objtype="body" objname="hand"/>
    <accelerometer site="s"/><velocimeter site="s"/><gyro site="s"/><force site="s"/>
    <torque site="s"/><rangefinder site="s"/><camprojection site="s" camera="eye"/>
    <distance geom1="tip" geom2="g" cutoff="5"/>
  </sensor>
</mujoco>"""


def test_every_kind_says_what_mujoco_says_of_that_instant() -> None:
    spec = mujoco.MjSpec.from_string(KINDS)
    for place, sensor in enumerate(spec.sensors):
        sensor.name = f"{place} {sensor.type}"
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.3
    for _ in range(150):
        mujoco.mj_step(model, data)
    whole = copy.copy(data)
    mujoco.mj_forward(model, whole)
    for index in range(model.nsensor):
        name = model.sensor(index).name
        (said,) = NamedSensors(model, [name]).read(data).values()
        np.testing.assert_allclose(said, whole.sensor(name).data, atol=1e-12, err_msg=name)
    assert all(whole.sensor(index).data.any() for index in range(model.nsensor))
