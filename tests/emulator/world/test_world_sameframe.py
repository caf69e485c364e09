"""Offsets under a micrometre: MuJoCo leaves them out, a world of micrometres does not."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator.world import load_model

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
