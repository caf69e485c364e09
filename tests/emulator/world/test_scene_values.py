"""Values of a scene in a model: what compiling them gives, and nothing of them afterwards."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.emulator.world import SceneValues, every_key, find_keys, load_model
from evs.emulator.world.model import bytes_of
from evs.msgs import EvsError

SCENES = Path(__file__).parents[3] / "config/scenes"

OWN = {
    "sun": ".3 .4 .5",
    "shine": ".2 .2 .2",
    "lamp_pos": "0 -1 3",
    "head": ".1 .1 .1",
    "paint": ".2 .3 .4 .9",
    "emission": "0.1",
    "box": ".5 .6 .7 1",
    "friction": "0.8",
    "mass": "2",
    "inertia": "0.3 0.4 0.6",
    "place": "0 0 1",
    "damping": "0.3",
    "loss": "0",
    "armature": "0.01",
    "stiffness": "1",
    "gain": "40",
    "bias": "0 -40 -2",
    "eye_pos": "0 -2 1",
    "fovy": "45",
    "gravity": "0 0 -9.81",
}


def robot(**other: str) -> mujoco.MjModel:
    """An arm and a ball, with some other words in its MJCF."""
    has = {**OWN, **other}
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option gravity="{has["gravity"]}"/>
  <visual><headlight diffuse="{has["head"]}"/></visual>
  <asset>
    <material name="paint" rgba="{has["paint"]}" emission="{has["emission"]}"/>
    <material name="wax" rgba=".9 .8 .7 1"/>
  </asset>
  <worldbody>
    <light name="sun" directional="true" dir="0 0 -1" diffuse="{has["sun"]}"
      specular="{has["shine"]}"/>
    <light name="lamp" mode="trackcom" pos="{has["lamp_pos"]}"/>
    <light name="dark" active="false"/>
    <geom name="floor" type="plane" size="5 5 .1" material="paint" friction="{has["friction"]}"/>
    <camera name="eye" mode="track" pos="{has["eye_pos"]}" xyaxes="1 0 0 0 .5 1"
      fovy="{has["fovy"]}"/>
    <camera name="lens" sensorsize="1 1" focal="1 1" resolution="9 9"/>
    <camera name="aimed" mode="targetbody" target="arm"/>
    <body name="arm" pos="{has["place"]}">
      <joint name="hinge" axis="0 1 0" damping="{has["damping"]}" frictionloss="{has["loss"]}"
        armature="{has["armature"]}" stiffness="{has["stiffness"]}"/>
      <inertial pos="0.1 0 0" mass="{has["mass"]}" diaginertia="{has["inertia"]}"/>
      <geom name="box" type="box" size=".1 .1 .1" rgba="{has["box"]}"/>
      <geom name="hull" size=".2" group="3"/>
    </body>
    <body name="ball" pos="1 0 1"><freejoint name="free"/><geom name="wax" size=".1"
      material="wax"/>
      <body name="dice"><joint name="turn" type="ball"/><geom size=".1" pos=".2 0 0"/></body></body>
  </worldbody>
  <actuator>
    <general name="servo" joint="hinge" gainprm="{has["gain"]}" biastype="affine"
      biasprm="{has["bias"]}"/>
  </actuator>
  <keyframe><key name="home" qpos="0.3 1 0 2 1 0 0 0 1 0 0 0"/></keyframe>
</mujoco>""")


# values -> the words of an MJCF that mean the same
COMPILED: dict[str, tuple[dict[str, float], dict[str, str]]] = {
    "diffuse": ({"light.sun.diffuse.g": 0.1}, {"sun": ".3 .1 .5"}),
    "brightness": ({"light.sun.brightness": 2.0}, {"sun": ".6 .8 1", "shine": ".4 .4 .4"}),
    "a light's place": ({"light.lamp.pos.x": 0.5}, {"lamp_pos": ".5 -1 3"}),
    "headlight": (
        {"headlight.diffuse.r": 0.4, "headlight.diffuse.b": 0.0},
        {"head": ".4 .1 0"},
    ),
    "material": (
        {"material.paint.rgb.r": 0.7, "material.paint.alpha": 0.5},
        {"paint": ".7 .3 .4 .5"},
    ),
    "emission": ({"material.paint.emission": 0.6}, {"emission": "0.6"}),
    "colour": ({"geom.box.rgb.b": 0.25, "geom.box.alpha": 0.75}, {"box": ".5 .6 .25 .75"}),
    "friction": ({"geom.floor.friction": 1.5}, {"friction": "1.5"}),
    "mass": ({"body.arm.mass": 3.0}, {"mass": "3", "inertia": "0.45 0.6 0.9"}),
    "a body's place": ({"body.arm.pos.x": 0.2, "body.arm.pos.z": 1.5}, {"place": ".2 0 1.5"}),
    "damping": ({"joint.hinge.damping": 0.6}, {"damping": "0.6"}),
    "frictionloss": ({"joint.hinge.frictionloss": 0.2}, {"loss": "0.2"}),
    "armature": ({"joint.hinge.armature": 0.5}, {"armature": "0.5"}),
    "stiffness": ({"joint.hinge.stiffness": 4.0}, {"stiffness": "4"}),
    "strength": ({"actuator.servo.strength": 0.5}, {"gain": "20", "bias": "0 -20 -1"}),
    "a camera's place": ({"camera.eye.pos.y": -3.0}, {"eye_pos": "0 -3 1"}),
    "fovy": ({"camera.eye.fovy": 60.0}, {"fovy": "60"}),
    "gravity": ({"option.gravity.z": -1.6}, {"gravity": "0 0 -1.6"}),
}


def arrays_of(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Every array of a model that physics and pictures follow from, by name."""
    names = [name for name in dir(model) if isinstance(getattr(model, name), np.ndarray)]
    found = {name: np.array(getattr(model, name)) for name in names}
    found |= {f"opt.{name}": np.array(getattr(model.opt, name)) for name in ("gravity", "timestep")}
    for name in ("ambient", "diffuse", "specular"):
        found[f"headlight.{name}"] = np.array(getattr(model.vis.headlight, name))
    return found


@pytest.mark.parametrize("name", COMPILED)
def test_a_value_in_a_model_is_what_its_mjcf_compiles_to(name: str) -> None:
    values, words = COMPILED[name]
    model = robot()
    before = arrays_of(model)
    SceneValues(model).put(values)
    found, expected = arrays_of(model), arrays_of(robot(**words))
    for field, array in expected.items():
        np.testing.assert_allclose(found[field], array, rtol=1e-6, atol=1e-9, err_msg=field)
    assert any(not np.array_equal(found[field], before[field]) for field in before)


def test_every_value_of_every_scene_goes_in_and_out_without_a_trace() -> None:
    random = np.random.default_rng(4)
    for path in sorted(SCENES.glob("*.xml")):
        model = load_model(path)
        before = bytes_of(model)
        values = {}
        for name, key in every_key(model).items():
            low, high = key.attribute.within
            values[name] = float(np.clip(key.read(model) + 0.1 * random.random(), low, high))
            if words := key.words(model):
                values[name] = max(words.values())
        scene = SceneValues(model)
        scene.put(values)
        changed = bytes_of(model)
        assert changed != before
        # a pure function of the values, whatever was there before
        other = {name: value for name, value in values.items() if random.random() < 0.3}
        scene.put(other)
        assert bytes_of(model) not in (before, changed)
        scene.put(dict(reversed(values.items())))
        assert bytes_of(model) == changed
        scene.put({})
        assert bytes_of(model) == before, path.name
        assert scene.values == {}


def test_edits_of_others_stay() -> None:
    model = robot()
    scene = SceneValues(model)
    scene.put({"geom.box.rgb.r": 0.1, "body.arm.mass": 1.0})
    model.geom("floor").rgba[:] = (0.1, 0.2, 0.3, 1.0)
    model.dof_damping[:] = 7.0
    scene.put({"geom.box.rgb.r": 0.9})
    assert model.geom("floor").rgba[0] == np.float32(0.1)
    assert model.dof_damping[0] == 7.0
    assert model.body("arm").mass[0] == 2.0


def test_what_an_author_gave_as_statistics_stays() -> None:
    spec = mujoco.MjSpec.from_file(str(SCENES / "cartpole.xml"))
    spec.stat.extent, spec.stat.center, spec.stat.meansize = 2.0, (1.0, 2.0, 3.0), 0.7
    model = spec.compile()
    SceneValues(model).put({"body.pole.mass": 5.0, "body.cart.pos.z": 4.0})
    assert (model.stat.extent, model.stat.meansize) == (2.0, 0.7)
    assert model.stat.center.tolist() == [1.0, 2.0, 3.0]


def test_the_mean_inertia_follows_from_masses_unless_its_author_gave_it() -> None:
    model, heavier = robot(), robot(**COMPILED["mass"][1])
    # what MuJoCo makes of such an edit: its later versions leave the mean inertia alone
    edited = robot()
    edited.body_mass[:], edited.body_inertia[:] = heavier.body_mass, heavier.body_inertia
    mujoco.mj_setConst(edited, mujoco.MjData(edited))
    expected = edited.stat.meaninertia
    assert expected in (heavier.stat.meaninertia, model.stat.meaninertia)
    SceneValues(model).put(COMPILED["mass"][0])
    assert model.stat.meaninertia == expected
    model = robot()
    model.stat.meaninertia = 7.0
    SceneValues(model).put(COMPILED["mass"][0])
    assert model.stat.meaninertia == 7.0


def test_rotation_vectors_turn_about_their_own_axes() -> None:
    model = robot()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    eye = model.camera("eye").id
    upright = data.cam_xmat[eye].reshape(3, 3).copy()
    lamp = model.light("sun").id
    SceneValues(model).put(
        {"camera.eye.rotvec.z": 90.0, "light.sun.rotvec.x": 30.0, "body.arm.rotvec.y": 20.0}
    )
    mujoco.mj_forward(model, data)
    turned = data.cam_xmat[eye].reshape(3, 3)
    # about the axis that it looks along: what was right is up
    np.testing.assert_allclose(turned[:, 2], upright[:, 2], atol=1e-12)
    np.testing.assert_allclose(turned[:, 0], upright[:, 1], atol=1e-12)
    tilt = np.deg2rad(30.0)
    np.testing.assert_allclose(data.light_xdir[lamp], (0, np.sin(tilt), -np.cos(tilt)), atol=1e-7)
    np.testing.assert_allclose(data.body("arm").xmat[0], np.cos(np.deg2rad(20.0)), atol=1e-12)


def test_an_episode_begins_where_the_values_say() -> None:
    model = robot()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    scene = SceneValues(model)
    before = bytes_of(model)
    scene.put(
        {
            "joint.hinge.qpos": -0.2,
            "joint.hinge.qvel": 3.0,
            "joint.free.pos.z": 1.5,
            "joint.free.vel.x": 0.5,
            "joint.free.rotvec.z": 90.0,
            "joint.turn.rotvec.x": 180.0,
        }
    )
    # where it begins is no part of the model
    assert bytes_of(model) == before
    scene.start(data)
    half = np.sqrt(0.5)
    expected = [-0.2, 1, 0, 1.5, half, 0, 0, half, 0, 1, 0, 0]
    np.testing.assert_allclose(data.qpos, expected, atol=1e-12)
    assert data.qvel[:2].tolist() == [3.0, 0.5]
    assert not data.qvel[2:].any()


def test_nominal_starts_are_those_of_home_or_of_qpos0() -> None:
    model = robot()
    keys = every_key(model)
    assert keys["joint.hinge.qpos"].read(model) == 0.3
    assert keys["joint.free.pos.z"].read(model) == 2.0
    bare = load_model(SCENES / "cartpole.xml")
    assert every_key(bare)["joint.hinge.qpos"].read(bare) == bare.qpos0[bare.joint("hinge").qposadr]


def test_a_colour_that_means_the_materials_is_made_another() -> None:
    model = robot()
    SceneValues(model).put({f"geom.wax.rgb.{letter}": 0.5 for letter in "rgb"})
    rgba = model.geom("wax").rgba
    assert rgba.tolist() != [0.5, 0.5, 0.5, 1.0]
    np.testing.assert_allclose(rgba, (0.5, 0.5, 0.5, 1.0), atol=1e-6)
    # one letter alone: the others are those that are seen
    model = robot()
    SceneValues(model).put({"geom.wax.rgb.g": 0.1})
    np.testing.assert_allclose(model.geom("wax").rgba, (0.9, 0.1, 0.7, 1.0), atol=1e-6)


def test_patterns_stand_for_what_has_the_attribute() -> None:
    model = robot()

    def names(written: str) -> list[str]:
        return [key.name for key in find_keys(model, written)]

    assert names("light.*.brightness") == ["light.sun.brightness", "light.lamp.brightness"]
    assert names("body.*.mass") == ["body.arm.mass", "body.ball.mass", "body.dice.mass"]
    # hidden in group 3, and without a name
    assert names("geom.*.rgb.g") == [f"geom.{name}.rgb.g" for name in ("floor", "box", "wax", "4")]
    assert names("geom.?ax.rgb") == [f"geom.wax.rgb.{letter}" for letter in "rgb"]
    assert names("camera.*.fovy") == ["camera.eye.fovy", "camera.aimed.fovy"]
    assert names("camera.*.rotvec.x") == ["camera.eye.rotvec.x", "camera.lens.rotvec.x"]
    assert names("option.gravity") == [f"option.gravity.{letter}" for letter in "xyz"]
    assert names("joint.*.qpos") == ["joint.hinge.qpos"]
    assert names("body.*.pos.x") == ["body.arm.pos.x", "body.dice.pos.x"]


def test_names_may_have_dots() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="a.b/c"><joint/><geom size="1"/></body></worldbody></mujoco>'
    )
    (key,) = find_keys(model, "body.a.b/c.mass")
    assert key.name == "body.a.b/c.mass"
    SceneValues(model).put({key.name: 2.0})
    assert model.body("a.b/c").mass[0] == 2.0


@pytest.mark.parametrize(
    ("written", "says"),
    [
        ("bdy.arm.mass", "no kind of object 'bdy'; there is: body"),
        ("body.amr.mass", "no body 'amr'; there is: arm"),
        ("body.arm.mas", "no attribute of a body 'mas'; there is: mass"),
        ("body.arm", "no attribute of a body 'arm'"),
        ("body", "no attribute of a body ''"),
        ("light.sun.diffuse.q", "no number of light diffuse 'q'; there is: b, g, r"),
        ("body.arm.mass.x", "no number of body mass 'x': there are none"),
        ("geom.x*.rgb", r"no geom fits 'x\*'; no geom 'x\*'; there is: box"),
        ("body.world.mass", "body 'world' has no mass: it has no mass"),
        ("body.ball.pos", "has a free joint, which has the pos instead"),
        ("light.dark.diffuse", "light 'dark' has no diffuse: it is off"),
        ("geom.hull.rgb", "geom 'hull' has no rgb: it is not shown"),
        ("camera.lens.fovy", "it has a sensorsize and a focal length"),
        ("camera.aimed.rotvec", "it looks at a body"),
        ("joint.free.qpos", "it has several coordinates"),
        ("joint.hinge.pos", "it is no free joint"),
        ("option.x.gravity", "no option 'x'"),
        (3, "no kind of object '3'"),
    ],
)
def test_what_is_no_key_is_refused_with_the_nearest_known(written: Any, says: str) -> None:
    with pytest.raises(EvsError, match=says) as error:
        find_keys(robot(), written)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (3, "scene is 3; give"),
        ({"body.arm.mass": 0.0}, r"scene.body.arm.mass is 0; give 1e-12 \.\.\. 1e\+12"),
        ({"body.arm.mass": "a"}, "scene.body.arm.mass is 'a'; give a finite number"),
        ({"body.arm.mass": float("nan")}, "scene.body.arm.mass is nan"),
        ({"geom.box.rgb": 0.5}, "scene.geom.box.rgb is no single number; give geom.box.rgb.r"),
        ({"body.*.mass": 0.5}, r"scene.body.\*.mass is no single number; give body.arm.mass"),
        ({"body.amr.mass": 0.5}, "scene.body.amr.mass: no body 'amr'; there is: arm"),
    ],
)
def test_values_that_make_no_model_change_nothing(values: Any, says: str) -> None:
    model = robot()
    scene = SceneValues(model)
    scene.put({"body.arm.mass": 5.0})
    before = bytes_of(model)
    with pytest.raises(EvsError, match=says) as error:
        scene.put(values if isinstance(values, int) else {"geom.box.rgb.r": 0.2, **values})
    assert "\n" not in str(error.value)
    assert bytes_of(model) == before
    assert scene.values == {"body.arm.mass": 5.0}


def test_a_copy_has_values_of_its_own() -> None:
    model = robot()
    own = bytes_of(model)
    scene = SceneValues(model)
    scene.put({"body.arm.mass": 5.0})
    both = bytes_of(model)
    twin = copy.copy(model)
    other = scene.copy_for(twin)
    other.put({})
    assert bytes_of(model) == both
    assert bytes_of(twin) == own
    scene.put({})
    assert bytes_of(model) == own
