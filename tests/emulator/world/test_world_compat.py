"""What MuJoCo 3.3 to 4 keep differently reads the same. MJCF here is what all of them know."""

from __future__ import annotations

import warnings
from pathlib import Path

import mujoco
import pytest

from evs.emulator.base.scene import LightKind
from evs.emulator.world import (
    MUJOCO_VERSION,
    ORTHOGRAPHIC,
    LiveScene,
    actuator_names,
    bind_camera,
    extract_scene,
    load_model,
    mobility_of,
)
from evs.emulator.world.compat import actuator_of
from evs.msgs import EvsError

MODEL = f"""<mujoco>
<asset><material name="plain"/><material name="worn" roughness=".25"/>
<texture name="t" type="2d" builtin="flat" width="4" height="4"/>
<material name="printed" texture="t"/></asset>
<worldbody>
<light directional="true" bulbradius=".25"/><light cutoff="30" attenuation="1 .5 .25"/>
<camera name="flat" {ORTHOGRAPHIC} fovy="2"/><camera name="usual" fovy="90"/>
<geom size=".1" material="plain"/><geom size=".1" material="worn"/>
<geom size=".1" material="printed"/>
<body><joint name="a"/><joint name="b"/><geom size=".1"/></body>
</worldbody>
<actuator><motor name="left" joint="a"/><motor name="right" joint="b"/></actuator>
</mujoco>"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


def test_lamps_are_what_the_file_says(model: mujoco.MjModel) -> None:
    head, sun, spot = extract_scene(model).lights
    assert head.headlight
    assert (sun.kind, sun.bulbradius_m) == (LightKind.DIRECTIONAL, 0.25)
    assert (spot.kind, spot.cutoff_deg, spot.attenuation) == (LightKind.SPOT, 30.0, (1, 0.5, 0.25))
    for lamp in (sun, spot):
        assert (lamp.intensity, lamp.range_m) == (0.0, 10.0)
        assert lamp.softness == pytest.approx(0.2)


def test_a_material_is_physical_only_where_the_file_says_so(model: mujoco.MjModel) -> None:
    scene = extract_scene(model)
    plain, worn, printed, _ = (scene.surfaces[index] for index in scene.geom_surface)
    assert (plain.metallic, plain.roughness) == (-1.0, -1.0)
    assert (worn.metallic, worn.roughness) == (-1.0, 0.25)
    assert scene.textures[printed.texture].srgb


def test_cameras_project_as_the_file_says(model: mujoco.MjModel) -> None:
    flat, usual = (bind_camera(model, name, 40, 30) for name in ("flat", "usual"))
    assert (flat.model.orthographic, usual.model.orthographic) == (True, False)
    assert (flat.model.fy, usual.model.fy) == (15.0, pytest.approx(15.0))


def test_actuators_have_names_and_controls_have_actuators(model: mujoco.MjModel) -> None:
    assert actuator_names(model) == ("left", "right")
    assert [actuator_of(model, control) for control in (0, 1)] == [0, 1]
    assert not mobility_of(model, bind_camera(model, "flat", 4, 3)).sleeping


def test_what_this_mujoco_does_not_know_names_its_version(tmp_path: Path) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text('<mujoco><worldbody><geom size="1" glitter="2"/></worldbody></mujoco>')
    with pytest.raises(EvsError, match=rf"'glitter'.*in MuJoCo {MUJOCO_VERSION}; a newer one"):
        load_model(scene)


@pytest.mark.parametrize("version", ["4.0.0", "4.0.1"])
@pytest.mark.parametrize("solver", ["Newton", "CG"])
@pytest.mark.parametrize("jacobian", ["sparse", "dense", "auto"])
@pytest.mark.parametrize("balls", [2, 12])
def test_a_wrong_newton_solver_is_warned_of_where_it_is_used(
    version: str, solver: str, jacobian: str, balls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mujoco, "__version__", version)
    bodies = "<body><freejoint/><geom size='.1'/></body>" * balls
    text = f"<option solver='{solver}' jacobian='{jacobian}'/><worldbody>{bodies}</worldbody>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{text}</mujoco>")
    # auto is sparse from 60 degrees of freedom on
    sparse = jacobian == "sparse" or (jacobian == "auto" and balls == 12)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        LiveScene(model)
    told = [str(one.message) for one in caught if "3767" in str(one.message)]
    assert len(told) == (version == "4.0.0" and solver == "Newton" and sparse)
    assert all("jacobian=" in one and "pip install 'mujoco!=4.0.0'" in one for one in told)
