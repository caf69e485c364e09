"""Data sets end to end: every channel on one clock, one stream in shards, killed and gone on."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.files import read
from evs.emulator import World
from evs.emulator.config import RunConfig
from evs.launch.main import main
from evs.msgs import Cause, EvsError
from evs.tools.dataset import Dataset, SceneFile, named, of_file
from evs.tools.dataset.make import make_dataset
from evs.tools.dataset.manifest import MANIFEST, listed
from reference.mjcf import BALL

pytestmark = pytest.mark.slow

TINY = ("--duration", "0.07", "sensor.width=43", "sensor.height=33", "--quiet")
"""besides --short: a shard of 50 ms and one of 20 ms"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes of the set, made at once by one worker."""
    folder = tmp_path_factory.mktemp("dataset") / "whole"
    assert main(["dataset", str(folder), "--short", "--scenes", "street,workshop", *TINY]) == 0
    return folder


@pytest.fixture
def ball(tmp_path: Path) -> str:
    (tmp_path / "ball.xml").write_text(BALL)
    return str(tmp_path / "ball.xml")


def small(ball: str, *more: tuple[str, str]) -> dict[str, SceneFile]:
    keys = [("sensor.width", "40"), ("sensor.height", "30"), ("render.renderer", "direct")]
    short = [("frames.spp", "4"), ("duration_s", "0.12"), ("scene.camera", "eye")]
    short += [("settle_s", "0")]
    return {"ball": of_file(ball, "ball", [*keys, *short, *more])}


def test_every_channel_is_there_on_one_clock(whole: Path) -> None:
    found = Dataset(whole)
    assert found.names == ("street", "workshop")
    for scene in found:
        described = found.manifest["scenes"][scene.name]
        assert (described["begin_us"], described["end_us"], described["frames"]) == (0, 70_000, 5)
        events = scene.events(0, 10**9)
        assert events.labels is not None
        assert len(events.array) == len(events.labels) > 20
        assert 0 < events.array["t"][0] <= events.array["t"][-1] <= 70_000
        assert (np.diff(events.array["t"]) >= 0).all()
        assert events.array["x"].max() < 43
        assert events.array["y"].max() < 33
        assert Cause.SIGNAL in events.labels["cause"]
        # 60 frames a second, each at the nearest tick
        assert [int(frame["t_us"]) for frame in scene.frames()] == [0, 17000, 33000, 50000, 67000]
        frame = scene.frame(4)
        shapes = {name: (value.shape, value.dtype.name) for name, value in frame.items()}
        assert shapes == {
            "t_us": ((), "int64"),
            "rgb": ((33, 43, 3), "float16"),
            "luminance": ((33, 43), "float32"),
            "depth": ((33, 43), "float32"),
            "normal": ((33, 43, 3), "float16"),
            "flow": ((33, 43, 2), "float32"),
            "geom_id": ((33, 43), "int32"),
            "body_id": ((33, 43), "int32"),
            "position": ((3,), "float64"),
            "orientation": ((4,), "float64"),
        }
        seen = frame["geom_id"] >= 0
        bodies = np.array(described["body_of_geom"])[frame["geom_id"]]
        assert np.array_equal(bodies[seen], frame["body_id"][seen])
        assert described["geoms"][0] in ("road", "floor")
        # the camera after every tick; at a frame's time it stands where the frame says
        poses, imu = scene.poses(), scene.imu()
        assert poses["t_us"].tolist() == list(range(1000, 70_001, 1000))
        assert np.array_equal(poses["position"][66], frame["position"])
        assert np.array_equal(poses["orientation"][66], frame["orientation"])
        assert len(imu) == 69
        # a car that drives and a rail that begins to move: gravity, and little beside it
        assert np.linalg.norm(imu["acceleration"].mean(0)) == pytest.approx(9.8, rel=0.2)
        # the whole as one recording
        recorded = read(whole / scene.name / "events.aedat4")
        assert np.array_equal(np.asarray(recorded), events.array)
        assert np.array_equal(recorded.imu, imu)
        assert (whole / scene.name / "sheet.png").stat().st_size > 1000


def test_the_geom_of_an_event_is_what_the_segmentation_shows_then(whole: Path) -> None:
    checked = 0
    for scene in Dataset(whole):
        for frame in list(scene.frames())[1:]:
            end_us = int(frame["t_us"])
            tick = scene.events(end_us - 1000, end_us)
            assert tick.labels is not None
            shown = frame["geom_id"][tick.array["y"], tick.array["x"]]
            assert np.array_equal(tick.labels["geom_id"], shown)
            checked += len(shown)
    assert checked > 5


def test_the_manifest_finds_one_changed_byte(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(whole, copy)
    sheet = tmp_path / "verified.png"
    assert main(["dataset", str(copy), "--verify", "--sheet", str(sheet), "--quiet"]) == 0
    assert sheet.stat().st_size > 1000
    victim = copy / "street" / "frames" / "0001" / "frames.npz"
    data = bytearray(victim.read_bytes())
    data[len(data) // 2] ^= 1
    victim.write_bytes(data)
    (copy / "workshop" / "sheet.png").unlink()
    assert main(["dataset", str(copy), "--verify"]) == 2
    config_json = capsys.readouterr().err
    assert "street/frames/0001/frames.npz has another checksum" in config_json
    assert "workshop/sheet.png is missing" in config_json
    assert (
        "remove street/frames/0001, workshop/sheet.png there, and give the command" in config_json
    )
    assert config_json.count("\n") == 1


def test_what_is_removed_of_a_set_that_was_whole_is_made_anew(ball: str, tmp_path: Path) -> None:
    """As --verify asks for: any shard, the events of a scene, its recording, its sheet."""
    folder, scenes = tmp_path / "a", small(ball, ("sensor.width", "24"), ("sensor.height", "18"))

    def made() -> int:
        return make_dataset(folder, scenes, shard_s=0.06).made

    assert made() == 4
    before, manifest = listed(folder), (folder / MANIFEST).read_bytes()
    (folder / "ball/events.aedat4").unlink()
    (folder / "ball/sheet.png").unlink()
    assert made() == 0
    assert listed(folder) == before
    shutil.rmtree(folder / "ball/frames/0001")
    assert made() == 1
    # the events are a chain, whose states are gone once it is whole
    shutil.rmtree(folder / "ball/events/0001")
    with pytest.raises(EvsError, match=r"state.bin: No such file.*; remove \S*/ball/events and"):
        made()
    assert not (folder / MANIFEST).exists()
    shutil.rmtree(folder / "ball/events")
    assert made() == 2
    assert listed(folder) == before
    assert (folder / MANIFEST).read_bytes() == manifest


def test_two_workers_make_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    words = ["dataset", str(tmp_path / "two"), "--short", "--scenes", "street,workshop", *TINY]
    assert main([*words, "--workers", "2"]) == 0
    assert listed(tmp_path / "two") == listed(whole)
    assert (tmp_path / "two" / MANIFEST).read_bytes() == (whole / MANIFEST).read_bytes()


def test_a_killed_command_goes_on_to_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    """SIGKILL as soon as the first shard is there, once more a shard later, then to the end."""
    folder = tmp_path / "killed"
    words = ["dataset", str(folder), "--short", "--scenes", "street,workshop", *TINY]
    command = [sys.executable, "-m", "evs.launch.main", *words]
    for shards in (1, 2):
        with subprocess.Popen(command, start_new_session=True) as process:
            give_up_s = monotonic_s() + 120
            while len(list(folder.glob("[!.]*/*/0*"))) < shards:
                assert process.poll() is None
                assert monotonic_s() < give_up_s
                sleep_s(0.005)
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        assert not (folder / MANIFEST).exists()
    assert main(["dataset", str(folder), "--verify", "--quiet"]) == 2
    assert main(words) == 0
    assert listed(folder) == listed(whole)
    assert main(["dataset", str(folder), "--verify", "--quiet"]) == 0


@pytest.mark.parametrize("model", ["plain", "evsnet"])
def test_shards_are_one_stream(ball: str, tmp_path: Path, model: str) -> None:
    """Cut after every 30 ms or not at all, and as a run without any shards: the same events."""
    more = [("model.name", model), ("scene.control", "random")]
    if model == "evsnet":
        # a chunk that no shard's end is a multiple of
        more += [("model.chunk", "7"), ("model.labels", "false")]
    scenes = small(ball, *more)
    for name, shard_s in (("cut", 0.03), ("once", 1.0)):
        assert make_dataset(tmp_path / name, scenes, shard_s=shard_s).whole
    cut, once = (Dataset(tmp_path / name)["ball"] for name in ("cut", "once"))
    assert len(list((tmp_path / "cut/ball/events").iterdir())) == 4
    events = once.events(0, 10**9)
    assert len(events.array) > 50
    for part in (cut.events(0, 10**9), cut.events(30_000, 70_000)):
        low, high = (0, 10**9) if len(part.array) == len(events.array) else (30_000, 70_000)
        wanted = once.events(low, high)
        assert np.array_equal(part.array, wanted.array)
        if model == "plain":
            assert np.array_equal(part.labels, wanted.labels)
    assert np.array_equal(cut.imu(), once.imu())
    for one, other in zip(cut.frames(), once.frames(), strict=True):
        # bytes: NaN is NaN
        assert {k: v.tobytes() for k, v in one.items()} == {
            k: v.tobytes() for k, v in other.items()
        }
    config: RunConfig = scenes["ball"].run()
    world = World.from_config(config)
    alone = [packet.events for packets in world.run(0.12) for packet in packets]
    assert np.array_equal(np.concatenate(alone), events.array)


def test_a_part_of_a_scene_keeps_the_scenes_time(ball: str, tmp_path: Path) -> None:
    for name, keys in (("all", ()), ("part", [("begin_s", "0.06"), ("duration_s", "0.06")])):
        make_dataset(tmp_path / name, small(ball, *keys))
    whole, part = (Dataset(tmp_path / name)["ball"] for name in ("all", "part"))
    assert part.time_us == (61_000, 120_000)
    events = part.events(0, 10**9).array
    assert events["t"][0] > 60_000
    poses = part.poses()
    assert np.array_equal(poses["position"], whole.poses()["position"][60:])
    # its first frame lies at its begin, and has the flow of the tick before
    frame = part.frame(0)
    assert int(frame["t_us"]) == 60_000
    assert np.isfinite(frame["flow"]).all()


@pytest.mark.parametrize("model", ["plain", "evsnet"])
def test_a_camera_that_settled_goes_on_with_what_it_saw(
    ball: str, tmp_path: Path, model: str
) -> None:
    """The events after 50 ms of settling are those of a recording from the first tick on."""
    keys = [("model.name", model), ("scene.control", "random")]
    if model == "evsnet":
        # 49 ticks are not enough, so that the recording begins at 56
        keys += [("model.chunk", "8"), ("model.labels", "false")]
    make_dataset(tmp_path / "all", small(ball, *keys))
    late = small(ball, *keys, ("settle_s", "0.049"), ("duration_s", "0.03"))
    make_dataset(tmp_path / "late", late, shard_s=0.02)
    whole, settled = (Dataset(tmp_path / name)["ball"] for name in ("all", "late"))
    begin_us = 56_000 if model == "evsnet" else 49_000
    assert settled.time_us == (begin_us + 1000, begin_us + 30_000)
    wanted = whole.events(begin_us, begin_us + 30_000).array
    assert len(wanted) > 10
    assert np.array_equal(settled.events(0, 10**9).array, wanted)
    assert int(settled.frame(0)["t_us"]) == begin_us
    # later than it settles: the same, of its own look at the scene
    make_dataset(tmp_path / "later", small(ball, *keys, ("settle_s", ".016"), ("begin_s", ".08")))
    later = Dataset(tmp_path / "later")["ball"]
    assert later.time_us == (81_000, 200_000)
    assert later.events(0, 10**9).array["t"][0] > 80_000


def test_another_seed_is_another_motion_and_other_noise(ball: str, tmp_path: Path) -> None:
    for seed in ("1", "2"):
        scenes = small(ball, ("seed", seed), ("scene.control_seed", seed), ("duration_s", "0.05"))
        make_dataset(tmp_path / seed, scenes)
    one, two = (Dataset(tmp_path / seed)["ball"].poses()["position"] for seed in "12")
    assert not np.array_equal(one, two)


def test_controls_of_a_file_drive_a_scene_wherever_it_is_made(ball: str, tmp_path: Path) -> None:
    np.save(tmp_path / "ctrl.npy", np.linspace(0, 2, 12)[:, None])
    keys = [("scene.control", "file"), ("scene.control_file", str(tmp_path / "ctrl.npy"))]
    scenes = small(ball, *keys)
    make_dataset(tmp_path / "a", scenes, shard_s=0.05)
    config: RunConfig = scenes["ball"].run()
    world = World.from_config(config)
    alone = [packet.events for packets in world.run(0.12) for packet in packets]
    found = Dataset(tmp_path / "a")["ball"].events(0, 10**9).array
    assert np.array_equal(np.concatenate(alone), found)


def test_a_folder_is_of_one_set_of_settings(ball: str, tmp_path: Path) -> None:
    folder = tmp_path / "one"
    make_dataset(folder, small(ball, ("duration_s", "0.02")))
    before = (folder / MANIFEST).read_bytes()
    again = make_dataset(folder, small(ball, ("duration_s", "0.02")))
    assert (again.made, again.kept, again.whole) == (0, 2, True)
    assert (folder / MANIFEST).read_bytes() == before
    other = small(ball, ("duration_s", "0.02"), ("seed", "3"))
    with pytest.raises(EvsError, match=r"scenes\.ball\.config\.seed is 0, not 3; take another"):
        make_dataset(folder, other)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(EvsError, match="holds something else"):
        make_dataset(tmp_path / "mine", small(ball))


def test_a_stop_leaves_what_is_whole_and_says_so(ball: str, tmp_path: Path) -> None:
    wanted: list[int] = []

    def stopped() -> bool:
        wanted.append(1)
        return len(wanted) > 1

    made = make_dataset(tmp_path / "a", small(ball), shard_s=0.05, stopped=stopped)
    assert (made.made, made.whole) == (1, False)
    assert not (tmp_path / "a" / MANIFEST).exists()
    assert make_dataset(tmp_path / "a", small(ball), shard_s=0.05).whole


def test_the_picture_of_a_set_and_what_it_holds(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet = tmp_path / "sheet.png"
    words = ["dataset", str(whole), "--short", "--scenes", "street,workshop", *TINY]
    assert main([*words, "--sheet", str(sheet)]) == 0
    assert sheet.stat().st_size > 1000
    capsys.readouterr()
    assert main(["dataset", str(whole), "--describe"]) == 0
    described = capsys.readouterr().out
    assert "street" in described
    assert "5 frames" in described
    assert main(["dataset", str(tmp_path / "not_yet"), "--describe"]) == 0
    assert "90.0 s" in capsys.readouterr().out
    assert not (tmp_path / "not_yet").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "DIR"),
        (["a", "b"], "give one folder for the data set, not 2"),
        (["a", "--scenes", "strete"], "no scene 'strete' in the set; it has: street"),
        (["a", "--scenes", ","], "--scenes is empty"),
        (["a", "--scene", "no.xml"], "no scene file 'no.xml'"),
        (["a", "--scene", "no.xml", "--scenes", "park"], "give one"),
        (["a", "--fps", "0", "--scenes", "park"], "at frames.fps: 0"),
        (["a", "--fps", "2000", "--scenes", "park"], "at most the 1000 ticks"),
        (["a", "--spp", "many", "--scenes", "park"], "at frames.spp: expected an integer"),
        (["a", "--duration", "-1", "--scenes", "park"], "at duration_s: -1 s"),
        (["a", "--sensor", "davis", "--scenes", "park"], "davis346"),
        (["a", "render.sp=4", "--scenes", "park"], "at render.sp: unknown key"),
        (["a", "--workers", "0", "--short", "--scenes", "park"], "workers is 0: give"),
        (["a", "--shard", "0", "--scenes", "park"], "--shard is 0: give 0.001"),
        (["a", "--spp", "0", "--scenes", "park"], "frames.spp is 0; with renderer path it must"),
        (["a", "model.name=evsnet", "--scenes", "park"], "or model.labels=false"),
        (["a", "--scenes", "park", "--sheet", "a.jpg"], "no picture format '.jpg'"),
        (["a", "--scenes", "park", "--sheet", "a.gif"], "--sheet is 'a.gif': end it in .png"),
        (["a", "--scenes", "park", "--sheet", "no/a.png"], "there is no folder"),
        (["a", "--scenes", "park", "--sheet", "a.png", "--describe"], "leave out one of them"),
        (["a", "--verify"], "is this the folder of a data set"),
        (["a", "--camera", "nose", "--scenes", "park"], "no camera 'nose'"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["dataset", *words]) == 2
    config_json = capsys.readouterr().err
    assert says in config_json
    assert config_json.count("\n") == 1


def test_what_the_folder_says_is_plain_json(whole: Path) -> None:
    described = json.loads((whole / MANIFEST).read_text())
    assert set(described) == {"kind", "versions", "shard_s", "scenes", "files"}
    assert set(described["files"]) == set(listed(whole))
    assert len(named("street").motion) == len(described["scenes"]["street"]["config"]["motion"])
