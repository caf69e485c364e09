"""Episodes with randomised sensors: the record is what was drawn, and gives the same bytes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evs
from evs.drivers.files import stream_of
from evs.emulator import World
from evs.emulator.config import RunConfig, SensorConfig, decoding
from evs.launch.main import main
from evs.tools.dataset import Dataset, of_file
from evs.tools.dataset.contact_sheet import words_of
from evs.tools.dataset.make import make_dataset, shard_count
from evs.tools.dataset.manifest import listed
from reference.mjcf import BALL

RANGES = {
    "pos_thres": "uniform(0.1, 0.3)",
    "neg_thres": "normal(1, 0.1) * pos_thres",
    "shot_noise_rate_hz": "log_uniform(1, 100)",
    "readout.row_ns": "choice(50, 100, 200)",
}
SMALL = [
    *(("sensor.width", "40"), ("sensor.height", "30"), ("render.renderer", "direct")),
    *(("frames.spp", "4"), ("duration_s", "0.06"), ("scene.camera", "eye"), ("settle_s", "0.01")),
]


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("scene") / "ball.xml"
    file.write_text(BALL)
    return str(file)


def scene(ball: str, *more: tuple[str, str]) -> Any:
    ranges = [(f"randomise.{key}", text) for key, text in RANGES.items()]
    return of_file(ball, "ball", [*SMALL, ("episodes", "3"), *ranges, *more])


@pytest.fixture(scope="module")
def made(ball: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set") / "a"
    assert make_dataset(folder, {"ball": scene(ball)}, shard_s=0.04).whole
    return folder


@pytest.mark.slow
def test_every_sequence_has_a_sensor_of_its_own(made: Path) -> None:
    found = Dataset(made)
    assert found.names == ("ball-0000", "ball-0001", "ball-0002")
    values = [sequence.sensor_values for sequence in found]
    assert all(set(one) == set(RANGES) for one in values)
    assert len({one["pos_thres"] for one in values}) == 3
    assert all(0.1 <= one["pos_thres"] <= 0.3 for one in values)
    assert all(len(sequence.events(0, 10**9).array) > 50 for sequence in found)
    # the camera moves otherwise in each, since its control has another seed
    ends = {sequence.poses()["position"][-1, 0] for sequence in found}
    assert len(ends) == 3


def test_manifest_and_headers_hold_the_values(made: Path, ball: str) -> None:
    manifest = json.loads((made / "manifest.json").read_text())["scenes"]
    for episode, sequence in enumerate(Dataset(made)):
        described = manifest[sequence.name]
        record = described["randomised"]
        assert record["episode"] == episode
        assert record["values"] == sequence.sensor_values
        assert described["config"]["randomise"] == RANGES
        assert described["config"]["sensor"]["pos_thres"] == record["values"]["pos_thres"]
        # the function of the package draws them again from the record
        base = replace(SensorConfig(**vars(scene(ball).sensor)))
        again = evs.SensorRanges(RANGES, base).draw(record["seed"], record["episode"])
        assert again.values == record["values"]
        for file in ("events/0000/events.npz", "events/0001/events.npz", "events.aedat4"):
            config = stream_of(made / sequence.name / file).config
            assert config["randomised"] == record
            assert config["sensor"]["readout"]["row_ns"] == record["values"]["readout.row_ns"]
            assert config["seed"] == episode


def test_the_recorded_configuration_gives_the_same_events(made: Path, ball: str) -> None:
    for sequence in Dataset(made):
        plain = dict(stream_of(made / sequence.name / "events.aedat4").config)
        del plain["randomised"]
        plain["scene"]["file"] = ball
        config: RunConfig = decoding.build(RunConfig, plain)
        alone = [
            packet.events for packets in World.from_config(config).run(0.07) for packet in packets
        ]
        events = np.concatenate(alone)
        # it settled for 10 ms
        assert np.array_equal(events[events["t"] > 10_000], sequence.events(0, 10**9).array)


def test_other_scenes_and_other_ranges_change_no_sensor(made: Path, ball: str) -> None:
    drawn = [one.sensor_values for one in Dataset(made)]
    found = scene(ball, ("episodes", "5"), ("randomise.neg_thres", "none"))
    for one, values in zip(found.draw("ball"), drawn, strict=False):
        assert one.values == {key: values[key] for key in RANGES if key != "neg_thres"}
    assert [one.values for one in scene(ball).draw("ball")] == drawn
    assert [one.values for one in scene(ball).draw("other")] != drawn
    assert [one.values for one in scene(ball, ("seed", "1")).draw("ball")] != drawn


def test_episodes_without_ranges_differ_in_their_seed_alone(ball: str, tmp_path: Path) -> None:
    plain = of_file(ball, "ball", [*SMALL, ("episodes", "2"), ("duration_s", "0.03")])
    assert shard_count({"ball": plain}) == 4
    make_dataset(tmp_path / "a", {"ball": plain})
    second = of_file(
        ball, "ball", [*SMALL, ("seed", "1"), ("scene.control_seed", "1"), ("duration_s", "0.03")]
    )
    make_dataset(tmp_path / "b", {"ball": second})
    one, other = Dataset(tmp_path / "a"), Dataset(tmp_path / "b")
    assert other.names == ("ball",)
    events = one["ball-0001"].events(0, 10**9).array
    assert np.array_equal(events, other["ball"].events(0, 10**9).array)
    assert len(events) > 20
    assert one["ball-0001"].sensor_values == {}
    assert "randomised" not in one.manifest["scenes"]["ball-0001"]


def test_the_sheet_and_the_description_show_the_values(
    made: Path, ball: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", str(made), "--describe"]) == 0
    told = capsys.readouterr().out
    for sequence in Dataset(made):
        assert f"{sequence.name}: {words_of(sequence.sensor_values)}" in told
    assert main(["info", str(made / "ball-0001/events.aedat4")]) == 0
    values = Dataset(made)["ball-0001"].sensor_values
    listed_values = ", ".join(f"{key} {value}" for key, value in values.items())
    assert f"randomised  {listed_values}" in capsys.readouterr().out
    words = [f"{key}={text}" for key, text in SMALL]
    ranges = [f"randomise.{key}={text}" for key, text in RANGES.items()]
    options = ["--scene", ball, "--episodes", "3", "--describe", *words, *ranges]
    assert main(["dataset", str(tmp_path / "planned"), *options]) == 0
    planned = capsys.readouterr().out
    # the draws are those that will be made
    assert all(f"{one.name}: {words_of(one.sensor_values)}" in planned for one in Dataset(made))
    assert "3 episodes" in planned


def test_the_sheet_has_a_line_for_the_values(made: Path) -> None:
    from evs.tools.dataset.contact_sheet import scene_page, set_page

    sequence = Dataset(made)["ball-0000"]
    page = scene_page(sequence)
    object.__setattr__(sequence, "sensor_values", {})
    below = page.shape[0] - scene_page(sequence).shape[0]
    # of letters 13 px high, and some ink in them
    assert 13 <= below <= 60
    assert page[-below:].min() < 128
    assert set_page(Dataset(made)).ndim == 3


def test_a_file_of_ranges_and_the_command_line_over_it(ball: str, tmp_path: Path) -> None:
    file = tmp_path / "ranges.toml"
    file.write_text(
        "[randomise]\npos_thres = 'uniform(0.1, 0.3)'\nreadout.row_ns = 'choice(50, 100, 200)'\n"
        "cutoff_hz = 'uniform(50, 60)'\n"
    )
    words = [f"{key}={text}" for key, text in SMALL]
    over = ["randomise.cutoff_hz=none", "--randomise", "dark_lux=uniform(0.01, 1)"]
    folder = tmp_path / "a"
    options = ["--scene", ball, "--randomise", str(file), "--episodes", "2", "--quiet"]
    assert main(["dataset", str(folder), *options, *words, *over]) == 0
    for sequence in Dataset(folder):
        assert set(sequence.sensor_values) == {"pos_thres", "readout.row_ns", "dark_lux"}


SCENE = {
    "light.*.brightness": "uniform(0.3, 1)",
    "geom.ball.rgb": "uniform(0.2, 1)",
    "camera.eye.fovy": "uniform(40, 60)",
    "joint.0.vel.z": "uniform(0, 2)",
}


@pytest.mark.slow
def test_scenes_are_drawn_recorded_and_shown(
    ball: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ranges = [(f"randomise.scene.{key}", text) for key, text in SCENE.items()]
    own = of_file(ball, "ball", [*SMALL, ("episodes", "2"), *ranges])
    folder = tmp_path / "a"
    assert make_dataset(folder, {"ball": own}, shard_s=0.04).whole
    manifest = json.loads((folder / "manifest.json").read_text())["scenes"]
    drawn = [one.values for one in own.draw_scenes("ball") if one]
    found = [sequence.scene_values for sequence in Dataset(folder)]
    assert found == drawn
    assert len({one["camera.eye.fovy"] for one in found}) == 2
    for sequence in Dataset(folder):
        described = manifest[sequence.name]
        assert described["randomised"]["scene"] == sequence.scene_values
        assert described["config"]["randomise"] == {f"scene.{key}": SCENE[key] for key in SCENE}
        stream = stream_of(folder / sequence.name / "events.aedat4")
        # the lens of this sequence, in the header and in the manifest
        assert stream.camera_info["k"] == described["camera_info"]["k"]
        focal = stream.camera_info["k"][0]
        fovy = np.deg2rad(sequence.scene_values["camera.eye.fovy"])
        assert focal == pytest.approx(15 / np.tan(fovy / 2), rel=1e-6)
        # configuration and values give the events again
        plain = dict(stream.config)
        del plain["randomised"]
        plain["scene"]["file"] = ball
        config: RunConfig = decoding.build(RunConfig, plain)
        world = World.from_config(config)
        world.reset(scene=sequence.scene_values)
        events = np.concatenate([p.events for packets in world.run(0.07) for p in packets])
        assert np.array_equal(events[events["t"] > 10_000], sequence.events(0, 10**9).array)
        assert len(events) > 50
        assert sequence.sensor_values == {}
        # the frames show them too
        world, view = World.with_view(replace(config, render=replace(config.render, spp=4)), True)
        world.reset(scene=sequence.scene_values)
        for _ in range(10):
            world.step()
        rgb = np.asarray(view.render()[1]).astype(np.float16)
        assert np.array_equal(sequence.frame(0)["rgb"], rgb)
    assert main(["dataset", str(folder), "--describe"]) == 0
    told = capsys.readouterr().out
    assert all(words_of(values) in told for values in found)
    assert main(["info", str(folder / "ball-0001/events.aedat4")]) == 0
    assert f"light.0.brightness {found[1]['light.0.brightness']}" in capsys.readouterr().out


@pytest.mark.slow
def test_two_workers_draw_the_same(made: Path, ball: str, tmp_path: Path) -> None:
    assert make_dataset(tmp_path / "a", {"ball": scene(ball)}, shard_s=0.04, workers=2).whole
    assert listed(tmp_path / "a") == listed(made)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["randomise.pos_thrs=uniform(1, 2)"], "at randomise.pos_thrs: no numeric key of [sensor]"),
        (["randomise.pos_thres=0.3"], "at randomise.pos_thres: '0.3' is no distribution"),
        (["randomise=uniform(1, 2)"], "at randomise: is a table; set one of its keys"),
        (["randomise.height=uniform(1, 2)"], "one size in all episodes; set sensor.height"),
        (["randomise.scene.geom.bal.rgb=uniform(0, 1)"], "scene.geom.bal.rgb: no geom 'bal'"),
        (["--episodes", "0"], "at episodes: 0; give 1 ... 10000"),
        (["--randomise", "no.toml"], "no file 'no.toml'"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], says: str, ball: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["dataset", "a", "--scene", ball, *words]) == 2
    told = capsys.readouterr().err
    assert says in told
    assert told.count("\n") == 1
    assert not (tmp_path / "a").exists()
