"""What of a model is not shown is said: one line each, with its name and the fix."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import warnings
from pathlib import Path

import mujoco
import pytest

from evs.emulator import EventCamera, LeftOutWarning, World
from evs.emulator.config import SensorConfig
from evs.emulator.world import extract_scene
from evs.launch import main

SMALL = SensorConfig("ideal", width=8, height=6)
FACES = 'type="cube" or type="skybox"'
SCENE = """
<mujoco>
  <asset>
    <texture name="env" type="2d" file="env.ktx"/>
    <texture name="paper" type="2d" builtin="flat" width="4" height="4"/>
    <texture name="cube" type="cube" builtin="flat" rgb1="1 1 1" width="4" height="4"/>
    <texture name="unused" type="2d" file="env.ktx"/>
    <material name="worn" texture="{worn}"/>
    <material name="nowhere" texture="unused"/>
  </asset>
  <worldbody>
    <geom size="1" material="worn"/>
    {light}
  </worldbody>
</mujoco>
"""


def ktx_file() -> bytes:
    """A picture of 2 x 2 texels, RGBA, as KTX 1 has it: header, one level."""
    magic = b"\xabKTX 11\xbb\r\n\x1a\n"
    header = struct.pack("<13I", 0x04030201, 0x1401, 1, 0x1908, 0x8058, 0x1908, 2, 2, 0, 0, 1, 1, 0)
    return magic + header + struct.pack("<I", 16) + bytes(range(16))


def model_of(light: str = "", worn: str = "paper") -> mujoco.MjModel:
    text = SCENE.format(light=light, worn=worn)
    return mujoco.MjModel.from_xml_string(text, {"env.ktx": ktx_file()})


LIGHTS = {
    '<light name="sky" type="image" texture="env"/>':
        f"light 'sky' is left out: its texture 'env' is a KTX file, which is not read; give it one "
        f"of PNG with {FACES}",
    '<light name="sky" type="image" texture="paper"/>':
        f"light 'sky' is left out: its texture 'paper' is flat; give it one with {FACES}",
    '<light type="image"/>':
        f"light '0' is left out: an image light has a texture; give it one with {FACES}",
}  # fmt: skip


@pytest.mark.parametrize("light", LIGHTS)
def test_an_image_light_without_an_image_is_said(light: str) -> None:
    with pytest.warns(LeftOutWarning) as said:
        scene = extract_scene(model_of(light))
    assert [str(warning.message) for warning in said] == [LIGHTS[light]]
    assert scene.left_out == (LIGHTS[light],)
    assert [kept.name for kept in scene.lights] == ["headlight"]


@pytest.mark.parametrize(
    "light",
    [
        '<light name="sky" type="image" texture="cube"/>',
        '<light type="image" texture="env" active="false"/>',
        '<light pos="0 0 3"/>',
    ],
)
def test_what_shines_or_is_switched_off_is_not_said(light: str) -> None:
    # warnings are errors here
    assert extract_scene(model_of(light)).left_out == ()


def test_a_material_goes_without_its_ktx_texture_and_that_is_said_once() -> None:
    with pytest.warns(LeftOutWarning) as said:
        scene = extract_scene(model_of(worn="env"))
    line = "texture 'env' is left out: it is a KTX file, which is not read; give a PNG file"
    assert [str(warning.message) for warning in said] == [line]
    assert scene.left_out == (line,)
    assert scene.textures == ()
    assert [surface.texture for surface in scene.surfaces] == [-1]


def test_the_warning_names_the_users_own_line() -> None:
    model = model_of('<light type="image"/>')
    with pytest.warns(LeftOutWarning) as said:
        world = World(model)
    with pytest.warns(LeftOutWarning) as also_said:
        EventCamera(model, sensor=SMALL)
    assert [warning.filename for warning in (*said, *also_said)] == [__file__] * 2
    assert world.left_out == (LIGHTS['<light type="image"/>'],)


@pytest.mark.integration
def test_a_command_says_it_in_one_line_and_the_report_keeps_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    light = '<light name="sky" type="image" texture="env"/>'
    (tmp_path / "env.ktx").write_bytes(ktx_file())
    (tmp_path / "scene.xml").write_text(SCENE.format(light=light, worn="paper"))
    size = ["sensor.width=8", "sensor.height=6", "--quiet"]
    scene = ["--scene", str(tmp_path / "scene.xml"), "--duration", "0.002", *size]
    out = ["-o", str(tmp_path / "frames.npz")]
    report = ["--report", str(tmp_path / "report.json")]
    line = f"evs: warning: {LIGHTS[light]}\n"
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert main.main(["render", *scene, *out]) == 0
        assert capsys.readouterr().err == line
    # as a program of its own, with Python's own settings
    done = subprocess.run(
        [sys.executable, "-m", "evs.launch.main", "emulate", *scene, *report],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stderr == line
    assert json.loads((tmp_path / "report.json").read_text())["warnings"] == [LIGHTS[light]]
