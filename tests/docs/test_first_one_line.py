"""What used to end in a traceback, or in a line that helped nobody: one line with the fix."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from evs.drivers.bus.curve_keys import write_keys
from evs.drivers.pictures import write_png
from evs.drivers.run.config import load
from evs.drivers.search_path import search_path
from evs.emulator import ClosedLoop, EventCamera, World
from evs.emulator.config import CameraConfig, SensorConfig
from evs.emulator.world import bind_camera, load_model
from evs.launch.main import main
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, TriggerPacket

XML = """
<mujoco>
  <option timestep="{timestep}"/>
  <asset><texture name="t" type="2d" builtin="flat" width="4" height="4"/>
    <material name="m" texture="t"/></asset>
  <worldbody>
    <camera name="lens" {lens} pos="0 0 3"/>
    <body name="b"><joint/><geom size=".2" material="m"/></body>
  </worldbody>
</mujoco>
"""
SMALL = SensorConfig(preset="dvs128", width=16, height=12)


def model(timestep: str = "0.001", lens: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML.format(timestep=timestep, lens=lens))


@pytest.mark.parametrize("focal", ["0 0", "-.01 .01", ".01 0"])
def test_a_lens_without_a_focal_length(focal: str) -> None:
    lens = f'sensorsize=".004 .003" resolution="400 300" focal="{focal}"'
    own = model(lens=lens)
    with pytest.raises(EvsError, match="camera 'lens' has a sensorsize, but not all of it"):
        bind_camera(own, "lens", 64, 48)
    assert bind_camera(own, "lens", 64, 48, CameraConfig(fovy=40.0)).model.fx > 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"a = {'[' * 900}{']' * 900}", "nested too deep"),
        (f"seed = {'9' * 5000}", "malformed TOML"),
        (f"seed = 0x{'f' * 5000}", "at seed: expected an integer, got one of 20000 bits"),
    ],
)
def test_toml_that_python_itself_gives_up_on(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(EvsError, match=said):
        load(str(file))
    sensor = SensorConfig(preset=str(file))
    with pytest.raises(EvsError):
        World(model()).add_camera(sensor=sensor)
    key, _, value = text.partition(" = ")
    if key == "seed":
        with pytest.raises(EvsError, match="at seed: expected an integer"):
            load(None, [("scene.file", "a.xml"), (key, value)])


@pytest.mark.parametrize("time", [1e13, -1e13, 1e300])
def test_a_time_that_no_stamp_holds(time: float) -> None:
    own = model()
    sensor, data = EventCamera(own, sensor=SMALL), mujoco.MjData(own)
    mujoco.mj_forward(own, data)
    data.time = time
    with pytest.raises(EvsError, match="stamps in us end at"):
        sensor.observe(data)


@pytest.mark.parametrize(
    ("field", "value"),
    [("geom_matid", 7), ("geom_bodyid", 9), ("mat_texid", 3), ("cam_bodyid", -2)],
)
def test_an_index_that_points_to_nothing(field: str, value: int) -> None:
    own = model()
    getattr(own, field).flat[0] = value
    with pytest.raises(EvsError, match=rf"model\.{field}\[0.*\] is {value}, but n"):
        EventCamera(own, sensor=SMALL)


def test_a_physics_step_that_never_fills_a_tick() -> None:
    with pytest.raises(EvsError, match="timestep is 1e-12 s"):
        World(model(timestep="1e-12"))


def test_a_urdf_with_nothing_but_visuals(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    shape = '<visual><geometry><sphere radius="1"/></geometry></visual>'
    file.write_text(f'<robot name="r"><link name="a">{shape}</link></robot>')
    with pytest.raises(EvsError, match=r"<mujoco><compiler discardvisual=\"false\"/></mujoco>"):
        World(file).add_camera(sensor=SMALL)


def test_a_class_of_the_same_name_is_told_apart() -> None:
    class MjModel:
        pass

    with pytest.raises(EvsError, match=r"not tests?.*\.MjModel|not test_first_one_line\.MjModel"):
        EventCamera(MjModel())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["emulate", "--duraton", "1"], "unrecognized arguments: --duraton; nearest: --duration ("),
        (["view", "x", "--sped=2"], "nearest: --speed ("),
        (["emulate", "x.xml", "--seed", "-1"], "at seed: -1; give 0 or more"),
        (["loop", "pencil", "--seed", "-1"], "--seed is -1: give 0 or more"),
    ],
)
def test_options(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(("closed", "code"), [(">&-", 2), ("2>&-", 0)])
def test_closed_standard_streams(closed: str, code: int) -> None:
    ended = subprocess.run(
        ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-m", "evs.launch.main", "help"],
        env={**os.environ, "PYTHONPATH": search_path()},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ended.returncode == code
    assert ("evs: standard output is closed" in ended.stderr) == (code == 2)
    assert ended.stderr.count("\n") <= 1


def test_a_damaged_mjb_may_be_of_another_mujoco(tmp_path: Path) -> None:
    file = tmp_path / "old.mjb"
    mujoco.mj_saveModel(model(), str(file))
    load_model(file)
    raw = bytearray(file.read_bytes())
    raw[4] ^= 0x55
    file.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(EvsError, match="of another MuJoCo than this"):
        load_model(file)


def test_keys_leave_no_half_of_a_pair(tmp_path: Path) -> None:
    (tmp_path / "arm.secret.key").symlink_to(tmp_path / "nowhere" / "at.all")
    with pytest.raises(EvsError, match="already exists"):
        write_keys(tmp_path / "arm")
    assert not (tmp_path / "arm.key").exists()


def test_a_picture_that_found_no_room_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new, old = tmp_path / "new.gif", tmp_path / "old.gif"
    old.write_bytes(b"old")
    picture = np.zeros((4, 4), np.uint8)

    def fill(_image: Image.Image, path: Path, *_: object, **__: object) -> None:
        path.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", fill)
    for path in (new, old):
        with pytest.raises(EvsError, match="No space left"):
            write_png(path, picture)
    assert [file.name for file in tmp_path.iterdir()] == ["old.gif"]


def test_what_python_shows_of_them() -> None:
    own = model()
    sensor, world = EventCamera(own, sensor=SMALL, name="eye"), World(own)
    assert repr(sensor) == "<evs.EventCamera 'eye': dvs128 16 x 12, nothing seen yet>"
    assert repr(world) == "<evs.World: no camera yet; t 0 s, ticks of 1000 us>"
    world.add_camera("lens", sensor=SMALL)
    (packet,) = world.step()
    assert repr(world) == "<evs.World: lens; t 0.001 s, ticks of 1000 us>"
    size = len(packet)
    assert repr(packet) == f"<EventPacket 0 of 'lens', 16 x 12: {size} events, 0 ... 1000 us>"
    assert repr(ImuPacket(2, camera="eye")) == "<ImuPacket 2 of 'eye': 0 samples>"
    assert repr(TriggerPacket(2)) == "<TriggerPacket 2 of 'camera': 0 triggers>"
    frame = Frame(1, 0, 5, 9, 10, np.zeros((12, 16), np.uint8))
    assert repr(frame) == "<Frame 1 of 'camera', 16 x 12 uint8, exposed 5 ... 9 us>"
    assert repr(ClosedLoop(own)).startswith("<evs.ClosedLoop around <evs.World: lens; t 0 s")
    assert repr(EventPacket(3, 5, 9, 2, 2)).endswith(": 0 events, 5 ... 9 us>")
