"""What Python lets through: values of a wrong type are one line with the key, numpy's are plain."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from evs.emulator import EventCamera, World
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SceneConfig, SensorConfig
from evs.msgs import EvsError

SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 .1"/>
    <body name="arm" pos="0 0 1"><freejoint/><geom size=".2"/></body>
  </worldbody>
</mujoco>
"""

SMALL = SensorConfig(width=8, height=6)


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(SCENE)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"camera": CameraConfig(lookat=(0, 0))}, "camera.lookat is (0, 0); give 3 finite"),
        ({"camera": CameraConfig(distance="3")}, "camera.distance is '3'; give a finite number"),
        ({"camera": CameraConfig(distance=True)}, "camera.distance is True; give a finite"),
        ({"camera": CameraConfig(focal_px=300.0)}, "camera.focal_px is 300.0; give 2 finite"),
        ({"camera": CameraConfig(principal_px=(np.nan, 0))}, "camera.principal_px"),
        ({"camera": CameraConfig(body="arm", pos=(np.nan, 0, 0))}, "camera.pos"),
        ({"camera": CameraConfig(body=3)}, "camera.body is 3; give a name"),
        ({"camera": CameraConfig(pos=(0, 0, 1))}, "camera.pos is given, but no body"),
        ({"camera": CameraConfig(quat=(0, 1, 0, 0))}, "camera.quat is given, but no body"),
        ({"sensor": SensorConfig(width="346")}, "sensor.width is '346'; give a whole number"),
        ({"render": RenderConfig(spp=2.5)}, "render.spp is 2.5; give a whole number"),
        ({"render": RenderConfig(shadows="no")}, "render.shadows is 'no'; give True or False"),
        ({"render": RenderConfig(lux_per_unit=np.inf)}, "render.lux_per_unit is inf"),
        ({"render": RenderConfig(seeds="fesh")}, "no render.seeds 'fesh'"),
        ({"render": "direct"}, "render= takes a RenderConfig, not 'direct'"),
        ({"model_config": "plain"}, "model= takes a ModelConfig, not 'plain'"),
        ({"model_config": ModelConfig(name=None)}, "model.name is None; give a name"),
        ({"seed": "one"}, "seed is 'one'; give a whole number"),
        ({"threads": 1.5}, "threads is 1.5; give a whole number"),
    ],
)
def test_a_wrong_value_is_one_line_with_its_key(model, options, message):
    with pytest.raises(EvsError) as caught:
        EventCamera(model, **{"sensor": SMALL, **options})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_world_refuses_them_too(tmp_path, model):
    scene = tmp_path / "scene.xml"
    scene.write_text(SCENE)
    with pytest.raises(EvsError, match=r"scene\.control_hz is '100'; give a finite number"):
        World(SceneConfig(file=str(scene), control_hz="100"))
    with pytest.raises(EvsError, match=r"seed is 0\.5; give a whole number"):
        World(model, seed=0.5)


def test_a_control_file_that_nothing_reads_is_refused(tmp_path):
    scene = tmp_path / "scene.xml"
    scene.write_text(SCENE)
    with pytest.raises(
        EvsError, match=r"scene\.control_file 'a\.csv' is not used: set scene.control"
    ):
        World(SceneConfig(file=str(scene), control_file="a.csv"))


def test_numpys_numbers_are_plain_in_the_header(model):
    camera = CameraConfig(lookat=np.array([0, 0, 1], np.float32), distance=np.float32(3))
    sensor = SensorConfig(width=np.int64(8), height=np.int32(6))
    render = RenderConfig(spp=np.int8(1), shadows=np.bool_(False))
    info = EventCamera(model, camera, sensor=sensor, render=render, seed=np.int64(5)).info
    told = json.loads(json.dumps(info.config))
    assert told["camera"]["lookat"] == [0.0, 0.0, 1.0]
    assert told["camera"]["distance"] == 3.0
    assert told["sensor"]["width"] == 8
    assert told["render"]["spp"] == 1
    assert told["render"]["shadows"] is False
    assert (info.seed, type(info.seed)) == (5, int)


def test_a_camera_may_stand_still_on_the_world_body(model):
    sensor = EventCamera(model, CameraConfig(body="world", pos=(0, 0, 3)), sensor=SMALL)
    assert sensor.info.camera == "world_camera"
