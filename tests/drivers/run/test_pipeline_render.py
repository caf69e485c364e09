"""`evs render`: what stands in its file, which instants, and every mistake as one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evs
from evs.drivers.pictures import channel_page
from evs.drivers.run import rendering
from evs.launch.main import main

SCENE = """
<mujoco>
  <option timestep=".001"/>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .9" rgb2=".1 .1 .2" width="16"
      height="96"/>
  </asset>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1"/>
    <camera name="eye" pos="0 -2 0.8" xyaxes="1 0 0 0 0.2 1"/>
    <geom type="plane" size="2 2 .1" rgba=".7 .3 .2 1"/>
    <body pos="0 0 1"><freejoint/><geom size=".3" rgba=".1 .9 .2 1"/></body>
  </worldbody>
</mujoco>"""
UNSTABLE = SCENE.replace("<freejoint/>", '<joint type="slide" stiffness="-9e7" ref="-1e-3"/>')
SIZE = ("--size", "24x18")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "ball.xml").write_text(SCENE)
    (tmp_path / "unstable.xml").write_text(UNSTABLE)
    (tmp_path / "ball.toml").write_text(
        '[scene]\nfile = "ball.xml"\n[[sink]]\ntype = "npz"\nfile = "events.npz"\n'
    )
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*words: str) -> int:
    return main(["render", *SIZE, *words])


def test_the_file_has_every_channel_at_every_instant(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("--scene", "ball.xml", "--duration", "0.1", "--fps", "50", "-o", "a.npz") == 0
    said = capsys.readouterr()
    assert said.err == ""
    size = Path("a.npz").stat().st_size
    assert said.out == (
        f"a.npz: 6 frames, {size / 1e6:.2f} MB: t_us, luminance, rgb, depth, distance, normal, "
        "position, geom_id, body_id, flow\n"
    )
    with np.load("a.npz") as file:
        stacks = {name: file[name] for name in file.files}
    info = json.loads(str(stacks.pop("info")))
    assert info["camera"] == "eye"
    assert info["camera_info"]["width"] == 24
    assert info["config"]["scene"]["file"] == "ball.xml"
    assert info["seed"] == 0
    assert info["tick_us"] == 1000
    assert {"evs", "mujoco", "numpy"} <= set(info["versions"])
    np.testing.assert_array_equal(stacks.pop("t_us"), np.arange(6) * 20_000)
    assert list(stacks) == list(rendering.CHANNELS)
    assert all(stack.shape[:3] == (6, 18, 24) for stack in stacks.values())

    # the same as the Python face gives
    world = evs.World("ball.xml")
    view = world.add_view("eye", sensor=evs.SensorConfig(width=24, height=18), rgb=True)
    for frame in range(6):
        while world.tick < 20 * frame:
            world.step()
        truth = view.ground_truth()
        luminance, rgb = view.render()
        expected: dict[str, Any] = {"luminance": luminance, "rgb": rgb}
        expected |= {name: getattr(truth, name) for name in rendering.TRUTH}
        for name, stack in stacks.items():
            assert stack[frame].tobytes() == expected[name].tobytes(), name
    # the ball falls: downwards is +y; before the first tick nothing is known of motion
    ball = stacks["body_id"][-1] == 1
    assert (stacks["flow"][-1][ball][:, 1] > 10).all()
    assert np.isnan(stacks["flow"][0]).all()


def test_the_luminance_is_that_of_a_camera_with_pixels(folder: Path) -> None:
    words = ("--scene", "ball.xml", "--duration", "0.005", "--fps", "tick", "--spp", "2")
    assert run(*words, "--channels", "luminance", "-o", "a.npz", "--quiet") == 0
    with np.load("a.npz") as file:
        assert set(file.files) == {"info", "t_us", "luminance"}
        light = file["luminance"]
    world, sensor = evs.World("ball.xml"), evs.SensorConfig(width=24, height=18)
    camera = world.add_camera("eye", sensor=sensor, render=evs.RenderConfig(spp=2))
    for tick in range(1, 6):
        world.step()
        assert light[tick].tobytes() == camera.luminance.tobytes()


def test_the_same_bytes_on_any_number_of_threads_and_instruction_set(folder: Path) -> None:
    files = []
    for name, words in (("a", ["threads=1"]), ("b", ["threads=3", "render.isa=portable"])):
        words += ["--scene", "ball.xml", "--duration", "0.04", "-o", f"{name}.npz", "--quiet"]
        assert run(*words) == 0
        with np.load(f"{name}.npz") as file:
            files.append({key: file[key].tobytes() for key in file.files if key != "info"})
    assert files[0] == files[1]


def test_a_pipeline_with_sinks_is_rendered_and_writes_no_events(folder: Path) -> None:
    assert run("ball.toml", "--duration", "0", "-o", "a.npz", "--quiet", "--channels", "depth") == 0
    assert not Path("events.npz").exists()
    with np.load("a.npz") as file:
        assert file["depth"].shape == (1, 18, 24)


def test_a_preview_shows_the_last_frame(folder: Path) -> None:
    words = ("--scene", "ball.xml", "--duration", "0.02", "--fps", "tick", "--quiet")
    assert run(*words, "-o", "a.npz", "--preview", "a.png") == 0
    assert Path("a.png").read_bytes().startswith(b"\x89PNG")


def test_raster_has_all_but_colour() -> None:
    every = rendering.chosen_channels("all", "direct")
    assert every == rendering.CHANNELS
    assert set(every) - set(rendering.chosen_channels("all", "raster")) == {"rgb"}
    assert rendering.chosen_channels("flow, depth", "direct") == ("depth", "flow")


@pytest.mark.parametrize(
    ("duration_s", "fps", "tick_us", "expected"),
    [
        (0.0, 25.0, 1000, [0]),
        (0.0, None, 1000, [0]),
        (0.004, None, 1000, [0, 1, 2, 3, 4]),
        (0.1, 25.0, 1000, [0, 40, 80]),
        (0.3, 10.0, 1000, [0, 100, 200, 300]),
        (0.1, 30.0, 1000, [0, 33, 67, 100]),
        (0.002, 1000.0, 1000, [0, 1, 2]),
        (0.001, 2000.0, 500, [0, 1, 2]),
    ],
)
def test_instants(duration_s: float, fps: float | None, tick_us: int, expected: list[int]) -> None:
    assert list(rendering.instants(duration_s, fps, tick_us)) == expected


@pytest.mark.slow
def test_an_hour_at_any_rate_has_all_its_frames() -> None:
    for fps in (24.0, 29.97, 30.0, 60.0, 999.0):
        ticks = rendering.instants(3600.0, fps, 1000)
        assert len(ticks) == int(3600 * fps + 1e-6) + 1
        assert ticks[0] == 0
        assert len(set(ticks)) == len(ticks)


GOOD = ("--scene", "ball.xml", "--duration", "0", "-o", "a.npz")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--scene", "ball.xml"], ["-o/--out", "evs render --help"]),
        (["-o", "a.npz"], ["no scene"]),
        ([*GOOD, "-o", "a.npy"], ["end it in .npz"]),
        ([*GOOD, "-o", "ball.xml"], ["end it in .npz"]),
        ([*GOOD, "-o", "nowhere/a.npz"], ["no folder nowhere", "mkdir -p"]),
        ([*GOOD, "-o", "folder.npz"], ["it is a folder"]),
        ([*GOOD, "-o", "full.npz"], ["cannot write full.npz"]),
        ([*GOOD, "--fps", "2000"], ["more than the 1000 ticks"]),
        ([*GOOD, "--fps", "0"], ["--fps is 0"]),
        ([*GOOD, "--fps", "nan"], ["--fps is nan"]),
        ([*GOOD, "--fps", "fast"], ["--fps is 'fast'"]),
        ([*GOOD, "--channels", "depht"], ["no channel 'depht'", "depth"]),
        ([*GOOD, "--channels", ","], ["no channel is given"]),
        ([*GOOD, "--size", "24"], ["--size is '24'", "640x480"]),
        ([*GOOD, "--size", "0x9"], ["sensor.width is 0"]),
        ([*GOOD, "--duration", "-1"], ["duration_s"]),
        ([*GOOD, "--preview", "a.gif"], ["end it in .png"]),
        ([*GOOD, "record=a.aedat4"], ["record is a key of evs emulate"]),
        ([*GOOD, "sink.0.type=npz"], ["sink.0.type is a key of evs emulate"]),
        ([*GOOD, "--camera", "eys"], ["eys", "eye"]),
        ([*GOOD, "--spp", "0"], ["render.spp is 0"]),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(
    folder: Path, words: list[str], says: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "folder.npz").mkdir()
    (folder / "full.npz").symlink_to("/dev/full")
    before = sorted(folder.iterdir())
    assert main(["render", *words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert said.err.startswith("evs: ")
    assert all(part in said.err for part in says)
    assert sorted(folder.iterdir()) == before


def test_a_scene_is_never_written_over(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "scene.npz").write_text(SCENE)
    (folder / "ball.mjb").symlink_to("scene.npz")
    assert run("--scene", "ball.mjb", "-o", "scene.npz") == 2
    assert "is an input of this run" in capsys.readouterr().err
    assert (folder / "scene.npz").read_text() == SCENE


def test_a_world_that_explodes_leaves_the_frames_before(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("--scene", "unstable.xml", "--fps", "tick", "-o", "a.npz") == 2
    said = capsys.readouterr().err
    with np.load("a.npz") as file:
        frames = len(file["t_us"])
        assert file["flow"].shape == (frames, 18, 24, 2)
    assert 0 < frames < 1001
    assert f"a.npz has the {frames} frames until then" in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0])
def test_a_page_of_nothing_is_a_page(value: float) -> None:
    flat, deep = np.full((3, 4), value, np.float32), np.full((3, 4, 3), value, np.float32)
    frame = {
        "t_us": np.array(3),
        "luminance": flat,
        "rgb": deep,
        "depth": flat,
        "normal": deep,
        "position": deep,
        "flow": deep[..., :2],
        "geom_id": np.full((3, 4), -1, np.int32),
    }
    page = channel_page(frame)
    assert page.dtype == np.uint8
    assert page.shape[2] == 3


def test_pages_colour_what_they_say() -> None:
    flow = np.zeros((8, 8, 2), np.float32)
    flow[:, 4:] = (100, 0)
    page = channel_page({"flow": flow})
    red, white = (255, 0, 0), (255, 255, 255)
    assert (page == (255, 63, 63)).all(-1).any() or (page == red).all(-1).sum() > 1000
    assert (page == white).all(-1).sum() > 1000


def test_help_tells_the_keys_that_hold_here_and_no_others(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["render", "--help"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    assert "\n  render.spp=" in told
    assert "\n  duration_s=" in told
    for key in ("pace", "record", "publish", "report", "sink."):
        assert f"\n  {key}" not in told
