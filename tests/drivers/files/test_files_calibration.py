"""camera_info: through recordings, right against projected points, and as ROS
calibration YAML, read back by OpenCV's parser."""

from __future__ import annotations

from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest

from evs.drivers.files import calibration_yaml, stream_of
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.optics import camera_info
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene
from evs.launch.main import main
from evs.msgs import EvsError, StreamInfo

SCENE = """
<mujoco>
  <option timestep=".001"/>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1"/>
    <geom type="plane" size="2 2 .1"/>
    <camera name="lens" sensorsize=".004 .003" resolution="64 48" focal=".005 .006"
      principal=".0004 -.0002" pos=".2 -.1 3"/>
    <camera name="narrow" fovy="30" pos="0 0 3"/>
    <camera name="flat" projection="orthographic" fovy="2" pos="0 0 5"/>
    <body pos=".1 .2 1"><freejoint/><geom name="ball" type="sphere" size=".1"/></body>
  </worldbody>
</mujoco>
"""
PLUMB_BOB = (-0.31, 1e-05, 0.0011, -0.0007, -0.02)


def recorded(folder: Path, *words: str, name: str = "run.aedat4") -> Path:
    """A short recording of the scene."""
    scene, file = folder / "scene.xml", folder / name
    scene.write_text(SCENE)
    given = ["sensor.width=64", "sensor.height=48", "duration_s=0.003", "render.spp=1", *words]
    assert main(["emulate", "--scene", str(scene), "--record", str(file), "--quiet", *given]) == 0
    return file


def parsed(text: str) -> cv2.FileStorage:
    """By OpenCV's own parser, which wants a header."""
    flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
    return cv2.FileStorage("%YAML:1.0\n---\n" + text, flags)


def numbers(node: cv2.FileNode) -> list[float]:
    return [node.at(i).real() for i in range(node.size())]


@pytest.mark.parametrize("suffix", [".aedat4", ".npz"])
@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", PLUMB_BOB),
        ("rational_polynomial", (0.61, 0.11, 0.0, 0.0, 0.008, 0.98, 0.29, 0.03)),
        ("equidistant", (0.02, -0.006, 1e-07, 0.0)),
    ],
)
def test_the_calibration_file_holds_what_the_camera_had(
    model: str, d: tuple[float, ...], suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    file = recorded(
        tmp_path,
        "scene.camera=lens",
        "name=wrist_eye",
        f"camera.distortion_model={model}",
        f"camera.distortion={','.join(map(str, d))}",
        name=f"run{suffix}",
    )
    info = stream_of(file).camera_info
    assert info["distortion_model"] == model
    assert info["d"] == list(d)
    capsys.readouterr()
    assert main(["info", str(file), "--camera-info"]) == 0
    read = parsed(capsys.readouterr().out)
    assert read.getNode("image_width").real() == 64
    assert read.getNode("image_height").real() == 48
    assert read.getNode("camera_name").string() == "wrist_eye"
    assert read.getNode("distortion_model").string() == model
    for name, field, shape in (
        ("camera_matrix", "k", (3, 3)),
        ("distortion_coefficients", "d", (1, len(d))),
        ("rectification_matrix", "r", (3, 3)),
        ("projection_matrix", "p", (3, 4)),
    ):
        node = read.getNode(name)
        assert (node.getNode("rows").real(), node.getNode("cols").real()) == shape
        assert numbers(node.getNode("data")) == info[field]


def test_every_number_is_one_to_a_yaml_1_1_parser() -> None:
    # there 1e-05 is a string, and 1.0e-05 a number
    info = {
        "width": 4, "height": 3, "distortion_model": "equidistant", "d": [1e-05, 0.0, -2e-300, 1],
        "k": [1e22] * 9, "r": [1.5] * 9, "p": [0.25] * 12,
    }  # fmt: skip
    text = calibration_yaml(StreamInfo(4, 3, camera='the "wrist": 1', camera_info=info))
    assert "data: [1.0e-05, 0.0, -2.0e-300, 1.0]" in text
    assert "1.0e+22" in text
    assert 'camera_name: "the \\"wrist\\": 1"' in text


def test_an_ideal_camera_is_a_plumb_bob_of_zeros(tmp_path: Path) -> None:
    info = stream_of(recorded(tmp_path, "scene.camera=narrow")).camera_info
    focal = 24 / np.tan(np.radians(15))
    assert info["distortion_model"] == "plumb_bob"
    assert info["d"] == [0.0] * 5
    np.testing.assert_allclose(info["k"], [focal, 0, 31.5, 0, focal, 23.5, 0, 0, 1], rtol=1e-12)
    np.testing.assert_allclose(np.reshape(info["p"], (3, 4))[:, :3].ravel(), info["k"])
    assert info["r"] == np.eye(3).ravel().tolist()


@pytest.mark.parametrize("d", [(), PLUMB_BOB], ids=["ideal", "distorted"])
@pytest.mark.parametrize("name", ["lens", "narrow"])
def test_camera_info_projects_points_to_where_they_are_seen(
    name: str, d: tuple[float, ...]
) -> None:
    # the model's sensorsize, focal and principal, or fovy -> k -> OpenCV -> the rendered pixel
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    optics = CameraConfig(distortion_model="plumb_bob", distortion=d) if d else CameraConfig()
    bound = bind_camera(model, name, 640, 480, optics)
    snapshot, scene = SnapshotTaker(model, [bound]).snapshot(data, 0), extract_scene(model)
    renderer = NativeRenderer(scene, bound.model, RenderConfig(spp=1), 1)
    geom, _ = renderer.hits(snapshot, snapshot.cameras[0])
    rows, columns = np.nonzero(scene.geom_id[geom] == model.geom("ball").id)
    info, eye = camera_info(bound.model), data.camera(name)
    point = eye.xmat.reshape(3, 3).T @ (data.geom("ball").xpos - eye.xpos) * [1, -1, -1]
    matrix, still = np.reshape(info["k"], (3, 3)), np.zeros(3)
    seen = cv2.projectPoints(point[np.newaxis], still, still, matrix, np.array(info["d"]))[0]
    # 70 to 130 px wide: the middle of its outline is off the image of its centre by
    # f (r / d)^2 tan(off axis), 900 * 0.05^2 * 0.15 = 0.34 px at most
    assert len(rows) > 1000
    np.testing.assert_allclose([columns.mean(), rows.mean()], seen.ravel(), atol=0.45)


BAD = {
    "no fields": ({}, "distortion_model"),
    "old": ({"width": 4, "height": 3, "distortion_model": "plumb_bob", "d": [], "k": [1] * 9}, "r"),
    "torn": ({"width": 4, "height": 3, "distortion_model": "plumb_bob", "k": "123456789"}, "k"),
    "size": ({"width": True, "height": 3, "distortion_model": "plumb_bob"}, "width"),
    "nan": (
        {"width": 4, "height": 3, "distortion_model": "plumb_bob", "k": [float("nan")] * 9},
        "k",
    ),
}


@pytest.mark.parametrize(("info", "field"), BAD.values(), ids=BAD)
def test_what_a_recording_lacks_is_told(info: dict, field: str) -> None:
    with pytest.raises(EvsError, match=rf"camera_info\.{field},"):
        calibration_yaml(StreamInfo(4, 3, camera_info=info))


def test_an_orthographic_camera_has_no_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    file = recorded(tmp_path, "scene.camera=flat", "name=above")
    assert main(["info", str(file), "--camera-info"]) == 2
    assert "'above' is orthographic" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["camera.distortion_model=plumb_bob"], "camera.distortion has 0 coefficients"),
        (["camera.distortion_model=plumbbob"], "plumb_bob"),
        (["camera.distortion=nan,0,0,0,0"], "camera.distortion"),
        (
            ["camera.distortion_model=plumb_bob", "camera.distortion=-3,0,0,0,0"],
            "no ray leads to pixel (0, 0)",
        ),
        (["camera.vignetting=cos5"], "cos4"),
        (["camera.vignetting_polynomial=-5"], "times the light"),
        (
            [
                "scene.camera=flat",
                "camera.distortion_model=equidistant",
                "camera.distortion=0,0,0,0",
            ],
            "orthographic",
        ),
    ],
)  # fmt: skip
def test_bad_optics_are_one_line_and_exit_code_2(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(SCENE)
    words = ["scene.camera=narrow", *words] if "scene.camera=flat" not in words else words
    assert main(["emulate", "--scene", str(scene), "duration_s=0.002", *words]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
