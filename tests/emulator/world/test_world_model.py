"""Loading a model: scenes of every kind, one clear line for what is none, small offsets."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator.base.memory_limits import address_space
from evs.emulator.world import bind_camera, extract_scene, load_model, load_spec
from evs.emulator.world.model import new_data
from evs.msgs import EvsError

XML = "<mujoco><worldbody><geom name='ball' size='.1'/></worldbody></mujoco>"


def complaint(scene) -> str:
    with pytest.raises(EvsError) as caught:
        load_model(scene)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_a_path_a_string_a_binary_a_spec_and_a_model_load(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    model = load_model(path)
    binary = tmp_path / "scene.mjb"
    mujoco.mj_saveModel(model, str(binary))
    spec = mujoco.MjSpec.from_string(XML)
    for scene in (path, str(path), binary, str(binary), spec, model):
        assert load_model(scene).geom("ball").id == 0


def test_a_model_is_copied():
    model = mujoco.MjModel.from_xml_string(XML)
    copy = load_model(model)
    copy.opt.timestep = 0.5
    copy.geom_size[0, 0] = 9.0
    assert model.opt.timestep == 0.002
    assert model.geom_size[0, 0] == 0.1


def test_a_missing_file_lists_its_nearest_neighbours_first(tmp_path):
    for name in ("ant.xml", "humanoid.xml", "notes.txt", "walker.mjb"):
        (tmp_path / name).write_text(XML)
    text = complaint(tmp_path / "humaniod.xml")
    assert text.startswith(f"no scene file '{tmp_path}/humaniod.xml'")
    assert text.index("humanoid.xml") < text.index("ant.xml")
    assert "notes.txt" not in text


def test_a_missing_folder_a_folder_and_an_empty_folder(tmp_path):
    assert f"there is no folder '{tmp_path}/no'" in complaint(tmp_path / "no" / "x.xml")
    assert "no .xml or .mjcf or .mjb or .urdf file in" in complaint(tmp_path / "x.xml")
    (tmp_path / "arm.xml").write_text(XML)
    assert "is a folder; in" in complaint(tmp_path)
    assert complaint(tmp_path).endswith("there is: arm.xml")


def test_another_kind_of_file(tmp_path):
    (tmp_path / "arm.txt").write_text(XML)
    assert "is no .xml, .mjcf, .mjb or .urdf file" in complaint(tmp_path / "arm.txt")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<mujoco><worldbody><geom sise='1'/></worldbody></mujoco>", "unrecognized attribute"),
        ("<mujoco><worldbody><geom/></worldbody></mujoco>", "size 0 must be positive in geom"),
        ("<mujoco>", "XML parse error"),
        ("", "empty file"),
        ("<mujoco><asset><mesh file='no.stl'/></asset></mujoco>", "no.stl"),
    ],
)
def test_malformed_mjcf_gives_mujocos_message_and_the_file_in_one_line(tmp_path, text, says):
    path = tmp_path / "broken.xml"
    path.write_text(text)
    message = complaint(path)
    assert message.startswith(f"{path}: ")
    assert says in message


def test_a_broken_binary(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "broken.mjb"
    model = mujoco.MjModel.from_xml_string(XML)
    mujoco.mj_saveModel(model, str(path))
    for content in (b"", b"hello", path.read_bytes()[: path.stat().st_size // 2]):
        path.write_bytes(content)
        assert complaint(path).startswith(f"{path}: ")
    # MuJoCo's own warnings went to our log, not into a file of the working directory
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["broken.mjb"]


def test_a_broken_spec():
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(size=[0, 0, 0])
    assert complaint(spec).startswith("MjSpec: Error: size 0 must be positive")


def test_something_else_is_no_scene():
    assert "not int" in complaint(3)


SPECK = """<mujoco><worldbody><camera pos="0 0 5e-6"/>
<geom name="speck" size="2e-7" pos="9e-7 -5e-7 3e-7"/>
<body pos="1e-6 0 0" mocap="true"><geom name="carried" size="2e-7" pos="0 4e-7 0"/>
<geom name="counter" size="2e-7" pos="0 -4e-7 0"/></body>
<body pos="0 0 1"><freejoint/><geom name="large" size=".5" pos="1e-7 0 0"/></body>
</worldbody></mujoco>"""


@pytest.fixture
def speck(tmp_path: Path) -> Path:
    path = tmp_path / "speck.xml"
    path.write_text(SPECK)
    return path


def places(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return np.array(data.geom_xpos)


def test_mujoco_alone_leaves_them_out(speck: Path) -> None:
    assert not places(mujoco.MjModel.from_xml_path(str(speck)))[0].any()


def test_a_speck_lies_where_the_model_has_it(speck: Path) -> None:
    model = load_model(speck)
    found = places(model)
    expected = [[9e-7, -5e-7, 3e-7], [1e-6, 4e-7, 0.0], [1e-6, -4e-7, 0.0]]
    np.testing.assert_allclose(found[:3], expected, atol=1e-20)
    # beside half a metre, a tenth of a micrometre is nothing: the pose stays a copy
    assert model.geom_sameframe[3] == mujoco.mjtSameFrame.mjSAMEFRAME_BODY


def test_no_robot_has_any(robot_files: dict[str, Path]) -> None:
    for path in list(robot_files.values())[:12]:
        usual = mujoco.MjModel.from_xml_path(str(path))
        assert np.array_equal(load_model(path).geom_sameframe, usual.geom_sameframe)


def test_a_state_that_memory_does_not_hold_is_one_line() -> None:
    # more than other tests can have left free in this process
    model = mujoco.MjModel.from_xml_string("<mujoco><size memory='3G'/></mujoco>")
    with (
        address_space(10_000_000),
        pytest.raises(EvsError, match=r"state does not fit: .*allocate memory; give the"),
    ):
        new_data(model)


@pytest.mark.parametrize("ending", [".xml", ".mjb", ".urdf"])
def test_a_path_out_of_reach_is_one_line(tmp_path, ending):
    with pytest.raises(EvsError, match=r"^cannot reach '.*': File name too long; give another"):
        load_model(tmp_path / ("d" * 300 + ending))


PARTS = """<mujoco><asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/>
<texture name="t" type="2d" builtin="flat" width="4" height="4"/>
<material name="m" texture="t"/></asset><worldbody><light name="lamp"/><site/>
<camera name="eye" sensorsize=".004 .003" resolution="400 300" focal=".005 .006"/>
<geom size=".1" material="m"/><body><joint/><geom size=".1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("value", [99, -7])
@pytest.mark.parametrize(
    "field",
    [
        *("geom_matid", "site_matid", "mat_texid", "light_texid", "geom_bodyid", "jnt_bodyid"),
        *("body_jntadr", "body_dofadr", "body_geomadr", "jnt_qposadr", "jnt_dofadr", "tex_adr"),
        *("geom_type", "site_type", "light_type", "jnt_type", "tex_type", "cam_mode", "light_mode"),
    ],
)
def test_an_index_or_a_kind_out_of_range_is_one_line(field, value):
    model = mujoco.MjModel.from_xml_string(PARTS)
    value = value if field != "tex_adr" or value < 0 else 1000
    getattr(model, field)[0] = value
    assert complaint(model).startswith(f"model.{field}[0")
    # a model of somebody else's is not loaded
    with pytest.raises(EvsError, match=rf"^model\.{field}\[0.* is {value}, .*; put it back$"):
        extract_scene(model)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("cam_resolution", -1),
        *itertools.product(
            [
                *("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia"),
                *("geom_pos", "geom_quat", "geom_size", "site_pos", "site_quat", "site_size"),
                *("cam_pos", "cam_quat", "light_pos", "light_dir", "jnt_pos", "jnt_axis", "qpos0"),
                *("hfield_size", "mat_texrepeat"),
            ],
            [np.nan, np.inf, -np.inf],
        ),
    ],
)
def test_a_place_or_size_that_is_no_number_is_one_line(field, value, tmp_path):
    model = mujoco.MjModel.from_xml_string(PARTS)
    getattr(model, field).reshape(-1)[-1] = value
    assert re.search(rf"^model\.{field}\[.*\] is {value}, .*; put it back$", complaint(model))
    mujoco.mj_saveModel(model, str(tmp_path / "bad.mjb"))
    assert complaint(tmp_path / "bad.mjb").startswith(f"model.{field}[")
    with pytest.raises(EvsError, match=rf"^model\.{field}\["):
        extract_scene(model)


@pytest.mark.parametrize("field", ["cam_sensorsize", "cam_intrinsic"])
@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_intrinsics_that_are_no_numbers_are_one_line(field, place, value):
    model = mujoco.MjModel.from_xml_string(PARTS)
    values = getattr(model, field)[0]
    values[place % len(values)] = value
    with pytest.raises(EvsError, match="camera 'eye' has a sensorsize, but not all of it"):
        bind_camera(model, "eye", 4, 3)


def test_a_name_that_is_not_utf8_is_one_line(tmp_path):
    path = tmp_path / "latin.xml"
    path.write_bytes(PARTS.encode().replace(b'"lamp"', b'"l\xe4mp"'))
    expected = r"the model has a name that is not UTF-8, 'l\xe4mp': save its file as UTF-8"
    assert complaint(path) == expected


@pytest.mark.parametrize(
    "make",
    [evs.World, lambda scene: evs.Worlds(scene, 2), evs.ClosedLoop]
    + [lambda scene: evs.SceneRanges({}, scene), load_spec, lambda scene: load_model(Path(scene))],
    ids=["World", "Worlds", "ClosedLoop", "SceneRanges", "spec", "Path"],
)
def test_a_scene_of_a_package_is_named_anywhere(make, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert make("evs:config/scenes/cartpole.xml") is not None
    with pytest.raises(EvsError, match=r"cartpoel\.xml'; in '.*' there is: cartpole\.xml"):
        make("evs:config/scenes/cartpoel.xml")
    with pytest.raises(EvsError, match="no Python package 'evz' here; pip install evz"):
        make("evz:config/scenes/cartpole.xml")
