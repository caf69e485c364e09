"""Every mistake of a user: one clear line on stderr, exit code 2, no traceback, no output."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers.search_path import search_path
from evs.launch import main

pytestmark = pytest.mark.extremes

SCENE = """
<mujoco model="ball">
  <option timestep="0.001"/>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1"/>
    <camera name="eye" pos="0 -2 0.5" xyaxes="1 0 0 0 0.2 1"/>
    <camera name="top" pos="0 0 3"/>
    <geom type="plane" size="2 2 .1"/>
    <body pos="0 0 1"><freejoint/><geom size=".2" rgba="1 0 0 1"/></body>
  </worldbody>
  <keyframe><key name="up" qpos="0 0 1 1 0 0 0"/></keyframe>
</mujoco>
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with one good scene and several things that are none."""
    (tmp_path / "ball.xml").write_text(SCENE)
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody><goem/></worldbody></mujoco>")
    (tmp_path / "torn.xml").write_text("<mujoco><worldbody>")
    (tmp_path / "text.txt").write_text("")
    (tmp_path / "bad.toml").write_text("[scene]\nfile = 'ball.xml'\n[render\nspp = 1\n")
    (tmp_path / "typo.toml").write_text("[scene]\nfile = 'ball.xml'\n[render]\nsppp = 1\n")
    (tmp_path / "full.json").symlink_to("/dev/full")
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "there.npz").write_text("kept")
    return tmp_path


def emulate(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "evs.launch.main", "emulate", *words]
    environment = {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120
    )


GOOD = ("--scene", "ball.xml", "sensor.width=16", "sensor.height=12", "--duration", "0.005")

BAD = [
    # (words, what the line says)
    (["--scene", "bal.xml"], ["bal.xml", "ball.xml"]),
    (["--scene", "nowhere/ball.xml"], ["nowhere"]),
    (["--scene", "text.txt"], ["text.txt", ".xml"]),
    (["--scene", "."], ["folder"]),
    (["--scene", "broken.xml"], ["broken.xml", "goem"]),
    (["--scene", "torn.xml"], ["torn.xml"]),
    ([], ["--scene"]),
    ([*GOOD, "--record", "there.npz"], ["'there.npz' already exists: use --force", "overwrite"]),
    (["ball.xml", "other.xml"], ["two scenes, 'ball.xml' and 'other.xml'"]),
    (["ball.xml", "--scene", "other.xml"], ["are one key"]),
    (["nothing.toml"], ["no pipeline file 'nothing.toml'", "default"]),
    (["bad.toml"], ["bad.toml", "malformed TOML", "line 3"]),
    (["typo.toml"], ["at render.sppp: unknown key; nearest known: render.spp"]),
    ([*GOOD, "sensr.width=3"], ["at sensr.width: unknown key; nearest known: sensor.width"]),
    ([*GOOD, "render.spp=x"], ['at render.spp: expected an integer or none, got "x"']),
    ([*GOOD, "--spp", "1.5"], ["at render.spp: expected an integer or none, got 1.5"]),
    ([*GOOD, "--camera", "eys"], ["eys", "eye, top"]),
    ([*GOOD, "--sensor", "davis436"], ["no sensor 'davis436'; there is: davis346"]),
    ([*GOOD, "sensor.height=0"], ["sensor.height is 0"]),
    ([*GOOD, "sensor.width=-3"], ["sensor.width is -3"]),
    ([*GOOD, "sensor.width=1000000"], ["sensor.width is 1000000"]),
    ([*GOOD, "sensor.width=9223372036854775807"], ["sensor.width is 9223372036854775807"]),
    ([*GOOD, "sensor.pos_thres=0"], ["sensor.pos_thres is 0"]),
    ([*GOOD, "sensor.log=lin"], ["linlog"]),
    ([*GOOD, "scene.tick_us=0"], ["scene.tick_us", "0"]),
    ([*GOOD, "scene.tick_us=-1000"], ["scene.tick_us", "-1000"]),
    ([*GOOD, "scene.control=randm"], ["randm", "random"]),
    ([*GOOD, "scene.control=file", "scene.control_file=no.npy"], ["no.npy"]),
    ([*GOOD, "scene.control=random", "scene.control_hz=0"], ["scene.control_hz"]),
    ([*GOOD, "scene.keyframe=upp"], ["upp", "up"]),
    ([*GOOD, "camera.body=nobody"], ["nobody"]),
    ([*GOOD, "camera.fovy=0"], ["camera.fovy"]),
    ([*GOOD, "--duration", "0"], ["at duration_s", "more than 0 s"]),
    ([*GOOD, "--duration", "-1"], ["at duration_s", "more than 0 s"]),
    ([*GOOD, "--duration", "nan"], ["at duration_s: expected a finite number, got nan"]),
    ([*GOOD, "--renderer", "pith"], ["no renderer 'pith'; there is: path, direct, hybrid, raster"]),
    ([*GOOD, "--model", "evsnut"], ["no model 'evsnut'; there is: evsnet, plain, adaptive"]),
    ([*GOOD, "--pace", "lockstop"], ["at pace: no pace 'lockstop'; there is: lockstep"]),
    ([*GOOD, "--pace", "lockstep"], ["at duration_s: a closed loop runs until it is stopped"]),
    ([*GOOD, "--seeds", "fresh"], ["at render.seeds: no seeds 'fresh'; there is: fixed"]),
    ([*GOOD, "--spp", "0"], ["render.spp is 0"]),
    ([*GOOD, "--spp", "65"], ["render.spp is 65"]),
    ([*GOOD, "render.isa=sse"], ["sse", "portable"]),
    ([*GOOD, "render.headlight=on"], ["headlight", "off"]),
    ([*GOOD, "render.sky=on"], ["sky", "backdrop"]),
    ([*GOOD, "--threads", "-1"], ["threads is -1"]),
    ([*GOOD, "--record", "run.xyz"], ["run.xyz", ".aedat4, .npz"]),
    ([*GOOD, "--record", "missing/run.npz"], ["missing/run.npz", "mkdir -p missing"]),
    ([*GOOD, "--record", "missing/run.aedat4"], ["missing/run.aedat4", "mkdir -p missing"]),
    ([*GOOD, "--record", "ball.xml/run.npz"], ["ball.xml/run.npz"]),
    ([*GOOD, "--record", "folder.npz"], ["folder.npz", "folder"]),
    ([*GOOD, "--record", "/proc/run.aedat4"], ["/proc/run.aedat4"]),
    ([*GOOD, "--report", "missing/r.json"], ["missing/r.json", "mkdir -p"]),
    ([*GOOD, "--publish", "tpc://127.0.0.1:5560"], ["tpc://127.0.0.1:5560"]),
    ([*GOOD, "--publish", "tcp://127.0.0.1"], ["tcp://127.0.0.1"]),
    ([*GOOD, "sink.0.type=ros"], ["at sink.0.type: no sink type 'ros'", "rosbag2"]),
    (["--scene", "ball.xml", "--size", "64"], ["--size is '64'", "640x480"]),
    ([*GOOD, "--size", "64x48"], ["--size 64x48 and sensor.width=16 are one key"]),
    ([*GOOD, "render.spp=3", "--spp", "2"], ["--spp 2 and render.spp=3 are one key"]),
    ([*GOOD, "default", "humanoid"], ["two pipelines, 'default' and 'humanoid'"]),
    ([*GOOD, "--spp"], ["--spp", "evs emulate --help"]),
    ([*GOOD, "--sppp", "3"], ["--sppp", "evs emulate --help"]),
]


EVERY = pytest.mark.parametrize(
    ("words", "said"), BAD, ids=[" ".join(words[-2:]) for words, _ in BAD]
)


@EVERY
def test_a_mistake_is_one_line_and_exit_code_2(
    folder: Path,
    words: list[str],
    said: list[str],
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    code = main.main(["emulate", *words])
    # what native code writes is seen too: these are the file descriptors
    told = capfd.readouterr()
    check(code, told.out, told.err, said)
    # nothing half made is left behind
    assert sorted(folder.rglob("*")) == before


@pytest.mark.slow
@pytest.mark.campaign
@EVERY
def test_a_mistake_in_a_process_of_its_own(folder: Path, words: list[str], said: list[str]) -> None:
    before = sorted(folder.rglob("*"))
    ended = emulate(folder, *words)
    check(ended.returncode, ended.stdout, ended.stderr, said)
    assert sorted(folder.rglob("*")) == before


def test_a_few_mistakes_in_a_process_of_their_own(folder: Path) -> None:
    for words, said in (BAD[0], BAD[4], BAD[10], BAD[-1]):
        ended = emulate(folder, *words)
        check(ended.returncode, ended.stdout, ended.stderr, said)


def test_a_report_on_a_full_disk_is_told_and_costs_nothing_else(folder: Path) -> None:
    ended = emulate(folder, *GOOD, "--report", "full.json", "--record", "run.aedat4")
    assert ended.returncode == 2
    warning = "evs: warning: cannot write 'full.json': No space left on device\n"
    assert ended.stderr == warning
    assert "simulated         0.005 s in 5 ticks" in ended.stdout
    assert (folder / "run.aedat4.report.json").stat().st_size > 1000
    assert (folder / "run.aedat4").stat().st_size > 1000


def check(code: int, out: str, err: str, said: list[str]) -> None:
    assert "Traceback" not in err
    assert err.count("\n") == 1, err
    assert err.startswith("evs: ")
    for part in said:
        assert part in err
    assert out == ""
    assert code == 2


def test_a_port_in_use_is_told_and_an_older_recording_stays(folder: Path) -> None:
    (folder / "run.aedat4").write_text("last week's")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        words = ("--record", "run.aedat4", "--force", "--publish", address)
        ended = emulate(folder, *GOOD, *words)
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert f"port {address.rpartition(':')[2]} is in use" in ended.stderr
    assert (folder / "run.aedat4").read_text() == "last week's"
    assert not list(folder.glob("*.report.json"))


def test_a_scene_with_nothing_lit_runs_and_is_warned_of(folder: Path) -> None:
    dark = SCENE.replace('<light pos="0 0 3" dir="0 0 -1"/>', "")
    (folder / "dark.xml").write_text(dark)
    words = [*GOOD, "--scene", "dark.xml"]
    # a pixel in the dark has noise
    ended = emulate(folder, *words, "render.headlight=off", "sensor.photocurrent_pa=0")
    assert ended.returncode == 0
    assert ended.stderr.count("\n") == 1
    assert ended.stderr.startswith("evs: warning: ")
    assert "render.headlight=model" in ended.stderr
    assert "events            0 " in ended.stdout
    # with its headlight the same scene is lit
    lit = emulate(folder, *words)
    assert (lit.returncode, lit.stderr) == (0, "")
