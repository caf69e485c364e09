"""Physics that breaks down: MuJoCo would start over without a word, we say when, what and where."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.world import Physics, UnstableError

pytestmark = pytest.mark.extremes

PENDULUM = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    <body name="cart" pos="0 0 2"><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1"/>
      <body name="bob" pos="0 0 -1"><joint name="pivot" type="ball"/><geom size=".1"/></body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="rail" gear="1e12"/></actuator>
</mujoco>
"""


def pendulum(tick_us=1000):
    return Physics(mujoco.MjModel.from_xml_string(PENDULUM), tick_us)


def run(physics, ticks=1):
    for _ in range(ticks - 1):
        physics.advance()
    with pytest.raises(UnstableError) as caught:
        physics.advance()
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_mujoco_alone_starts_over_without_a_word():
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    old = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _text: None)
    try:
        for _ in range(5):
            mujoco.mj_step(model, data)
        data.ctrl[0] = 1.0
        mujoco.mj_step(model, data)
    finally:
        mujoco.set_mju_user_warning(old)
    # it raised nothing, and time went back: this is what the next tests are about
    assert data.time < 5 * model.opt.timestep


def test_an_explosion_ends_the_run_and_time_does_not_go_back():
    physics = pendulum()
    for _ in range(20):
        physics.advance()
    physics.data.ctrl[0] = 1.0
    before = physics.state
    text = run(physics)
    assert text.startswith("unstable at t = 0.020000 s: bad acceleration")
    assert "joint 'rail' of body 'cart'" in text
    assert physics.t_us == 20_000
    assert physics.data.time >= 0.02
    # and what the data says is true: it is that of the tick before
    np.testing.assert_array_equal(physics.state, before)
    assert np.isfinite(before).all()


@pytest.mark.parametrize(
    ("field", "index", "value", "says"),
    [
        ("qpos", 3, np.nan, "bad position (NaN, infinite or huge) at joint 'pivot' of body 'bob'"),
        ("qpos", 0, 1e11, "bad position (NaN, infinite or huge) at joint 'rail' of body 'cart'"),
        ("qvel", 2, -np.inf, "bad velocity (NaN, infinite or huge) at joint 'pivot' of body 'bob'"),
        ("ctrl", 0, np.nan, "bad control (NaN, infinite or huge) at actuator 'push'"),
        ("qfrc_applied", 0, np.inf, "bad acceleration"),
    ],
)
def test_every_bad_value_is_named(field, index, value, says, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    physics = pendulum()
    physics.advance()
    getattr(physics.data, field)[index] = value
    text = run(physics)
    assert says in text
    assert "t = 0.001000 s" in text
    # MuJoCo's own print and its file in the working directory are not needed any more
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_the_step_inside_a_tick_is_told():
    model = mujoco.MjModel.from_xml_string(
        PENDULUM.replace("<mujoco>", "<mujoco><option timestep='.00025'/>")
    )
    physics = Physics(model, 1000)
    # 2.25e6 m a step: over MuJoCo's limit of 1e10 m after the second of four
    physics.data.qpos[0], physics.data.qvel[0] = 1e10 - 4e6, 9e9
    text = run(physics)
    assert text.startswith("unstable at t = 0.000500 s: bad position")
    assert physics.tick == 0


def boxes(memory):
    many = "".join(
        f"<body name='box{i}' pos='{i % 10 * 0.01} 0 {0.05 + i // 10 * 0.01}'><freejoint/>"
        "<geom size='.1 .1 .1' type='box'/></body>"
        for i in range(60)
    )
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><size memory='{memory}'/><worldbody><geom type='plane' size='5 5 1'/>{many}"
        "</worldbody></mujoco>"
    )


def test_a_full_contact_buffer_ends_the_run_and_names_a_body():
    text = run(Physics(boxes(2_000_000), 1000))
    assert "contact buffer full at body 'box" in text
    assert "<size memory=" in text


def test_a_full_constraint_buffer_ends_the_run():
    assert "constraint buffer full at body 'box" in run(Physics(boxes(6_000_000), 1000))


def test_memory_that_ends_inside_mujoco_is_one_line_too():
    assert "mj_stackAlloc: out of memory" in run(Physics(boxes(1_100_000), 1000))


def test_resetting_the_data_by_hand_keeps_the_watch():
    physics = pendulum()
    physics.advance()
    mujoco.mj_resetData(physics.model, physics.data)
    physics.advance()
    physics.data.ctrl[0] = 1.0
    assert "bad acceleration" in run(physics)
