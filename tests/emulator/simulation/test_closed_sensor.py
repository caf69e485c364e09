"""Sensor.save and restore: an event camera inside a loop that somebody else owns."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator import EventCamera
from evs.emulator.config import ApsConfig, ImuConfig, ReadoutConfig, SensorConfig
from evs.msgs import EvsError

BALL = """
<mujoco>
  <option timestep=".001"/>
  <worldbody>
    <light pos="0 -1 3"/>
    <geom name="floor" type="plane" size="3 3 1" rgba=".3 .3 .3 1"/>
    <camera name="left" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
    <body pos="0 0 1"><freejoint/><geom size=".2" rgba=".9 .6 .3 1"/></body>
  </worldbody>
</mujoco>
"""
EVERYTHING = SensorConfig(
    "davis346", width=40, height=30, shot_noise_rate_hz=90.0, latency_us=1200.0,
    aps=ApsConfig(enabled=True, rate_hz=120.0, exposure_us=5000), imu=ImuConfig(enabled=True),
    readout=ReadoutConfig(order="arbiter", column_ns=2000),
)  # fmt: skip


def scene():
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    data.qvel[:3] = (0.8, 0.0, 1.0)
    return model, data


def course(sensor, model, data, calls):
    """What it said in some calls, between which different times pass."""
    said = []
    for call in range(calls):
        for _ in range(1 + (data.time * 1000 + call) % 3 >= 2):
            mujoco.mj_step(model, data)
        said.append(
            [sensor.observe(data).tobytes(), sensor.imu.tobytes()]
            + [frame.pixels.tobytes() for frame in sensor.frames]
        )
        mujoco.mj_step(model, data)
    return said


@pytest.mark.parametrize("cut", [0, 1, 2, 30])
def test_it_goes_on_where_it_was_saved(cut):
    model, data = scene()
    one = EventCamera(model, "left", sensor=EVERYTHING, seed=4)
    course(one, model, data, cut)
    blob, state = one.save(), mujoco.MjData(model)
    mujoco.mj_copyData(state, model, data)
    rest = course(one, model, data, 40)
    assert sum(len(events) for events, *_ in rest) > 16 * 100

    other = EventCamera(mujoco.MjModel.from_xml_string(BALL), "left", sensor=EVERYTHING, seed=5)
    other.restore(blob)
    assert other.packet is None
    assert course(other, model, state, 40) == rest
    np.testing.assert_array_equal(one.ground_truth().flow, other.ground_truth().flow)
    assert one.events_dropped == other.events_dropped


def test_a_refresh_and_a_refusal_before_it_is_saved_lose_nothing():
    model, data = scene()
    one = EventCamera(model, "left", sensor=EVERYTHING)
    course(one, model, data, 10)
    one.observe(data)
    with pytest.raises(EvsError, match="there is nothing between"):
        one.observe(data)
    other = EventCamera(model, "left", sensor=EVERYTHING)
    other.restore(one.save())
    mujoco.mj_step(model, data)
    np.testing.assert_array_equal(one.observe(data), other.observe(data))
    model.geom("floor").rgba[:3] = 0.8
    for sensor in (one, other):
        sensor.refresh()
    # nothing was seen since
    again = EventCamera(model, "left", sensor=EVERYTHING)
    again.restore(one.save())
    mujoco.mj_step(model, data)
    events = one.observe(data)
    np.testing.assert_array_equal(events, other.observe(data))
    np.testing.assert_array_equal(events, again.observe(data))


def test_what_is_not_its_own_is_refused():
    model, data = scene()
    one = EventCamera(model, "left", sensor=EVERYTHING)
    course(one, model, data, 3)
    blob = one.save()
    smaller = EventCamera(model, "left", sensor=SensorConfig("davis346", width=20, height=20))
    with pytest.raises(EvsError, match=r"camera\.sensor\.width was 40, here it is 20"):
        smaller.restore(blob)
    model.geom("floor").rgba[0] = 0.9
    changed = EventCamera(model, "left", sensor=EVERYTHING)
    with pytest.raises(EvsError, match="saved by another model"):
        changed.restore(blob)
    with pytest.raises(EvsError, match="is damaged"):
        one.restore(blob[:-3])
