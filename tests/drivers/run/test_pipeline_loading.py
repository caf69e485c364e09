"""Pipelines: precedence, paths, sinks, and what is refused before a run."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.run.config import (
    PIPELINES,
    PRESETS,
    PipelineConfig,
    about,
    find_pipeline,
    load,
    make_sink,
    pipelines,
)
from evs.drivers.run.config_reference import default_pipeline, describe
from evs.drivers.sink_config import SinkConfig
from evs.emulator import World
from evs.emulator.config import RunConfig, decoding
from evs.msgs import EvsError

SCENE = [("scene.file", "x.xml")]


def refused(*overrides: tuple[str, str]) -> str:
    with pytest.raises(EvsError) as caught:
        load(None, [*SCENE, *overrides])
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_command_line_wins_over_the_file_and_the_file_over_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "p.toml"
    file.write_text('seed = 1\nthreads = 2\n[scene]\nfile = "a.xml"\n[render]\nspp = 16\n')
    config = load(str(file), [("seed", "9"), ("sensor.width", "48")])
    assert (config.seed, config.threads, config.render.spp) == (9, 2, 16)
    assert (config.sensor.width, config.sensor.height) == (48, None)
    assert config.duration_s == PipelineConfig().duration_s


def test_paths_of_a_file_are_relative_to_it_and_others_to_the_working_directory(
    tmp_path: Path,
) -> None:
    file = tmp_path / "p.toml"
    file.write_text(
        'record = "r.npz"\nreport = "/abs/r.json"\n'
        '[scene]\nfile = "../a.xml"\ncontrol_file = "c.npy"\n'
        '[[sink]]\ntype = "npz"\nfile = "s.npz"\n[[sink]]\ntype = "zmq"\naddress = "tcp://*:5"\n'
    )
    config = load(str(file), [])
    assert config.scene.file == f"{tmp_path}/../a.xml"
    assert config.scene.control_file == f"{tmp_path}/c.npy"
    assert config.record == f"{tmp_path}/r.npz"
    assert config.report == "/abs/r.json"
    assert config.sink[0].file == f"{tmp_path}/s.npz"
    assert config.sink[1].address == "tcp://*:5"
    assert config.sensor.preset == "davis346"
    over = load(str(file), [("scene.file", "b.xml"), ("sink.0.file", "t.npz")])
    assert (over.scene.file, over.sink[0].file) == ("b.xml", "t.npz")


def test_a_sensor_file_and_the_home_folder_are_paths_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/home/somebody")
    file = tmp_path / "p.toml"
    file.write_text('[scene]\nfile = "~/a.xml"\n[sensor]\npreset = "mine.toml"\n')
    config = load(str(file), [("record", "~/r.npz")])
    assert config.sensor.preset == f"{tmp_path}/mine.toml"
    assert config.scene.file == "/home/somebody/a.xml"
    assert config.record == "/home/somebody/r.npz"


def test_a_scene_may_lie_in_a_package(tmp_path: Path) -> None:
    inside = Path(np.__file__).parent / "some" / "arm.xml"
    assert load(None, [("scene.file", "numpy:some/arm.xml")]).scene.file == str(inside)
    file = tmp_path / "p.toml"
    file.write_text('[scene]\nfile = "numpy:some/arm.xml"\n')
    assert load(str(file), []).scene.file == str(inside)
    said = refused(("scene.control_file", "no_such_package:x.npy"))
    assert "no Python package 'no_such_package'" in said
    # a drive letter and an address are no packages
    assert load(None, [("scene.file", "C:/x.xml")]).scene.file == "C:/x.xml"


def test_record_and_publish_are_sinks_too() -> None:
    config = load(None, [*SCENE, ("record", "a.AEDAT4"), ("publish", "tcp://127.0.0.1:1")])
    # a port in use is found out before an old recording is replaced
    assert config.sinks() == (
        SinkConfig.of(type="zmq", address="tcp://127.0.0.1:1"),
        SinkConfig.of(type="aedat4", file="a.AEDAT4"),
    )
    assert load(None, [*SCENE, ("record", "a.npz")]).sinks()[0].type == "npz"


def test_a_sink_can_be_made_on_the_command_line() -> None:
    config = load(None, [*SCENE, ("sink.0.type", "npz"), ("sink.0.file", "a.npz")])
    assert config.sinks() == (SinkConfig.of(type="npz", file="a.npz"),)


def test_the_emulators_part_says_nothing_of_outputs() -> None:
    scene = str(PIPELINES.parent / "scenes" / "pendulum.xml")
    words = [("record", "a.npz"), ("seed", "4"), ("render.spp", "1"), ("sensor.preset", "ideal")]
    config = load(None, [("scene.file", scene), *words])
    header = World.from_config(config).cameras[0].info.config
    assert set(header) == {field.name for field in dataclasses.fields(RunConfig)}
    assert (header["seed"], header["render"]["spp"]) == (4, 1)
    # so two recordings of one run, in different files, carry the same header
    assert "a.npz" not in str(header)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ([("pace", "lockstop")], "at pace: no pace 'lockstop'; there is: lockstep, "),
        ([("render.seeds", "fresh")], "at render.seeds: no seeds 'fresh'; there is: fixed"),
        ([("record", "a.bagpipe")], "no recording format '.bagpipe' (of a.bagpipe); names end"),
        ([("record", "a")], "no recording format '' (of a); names end in .aedat4"),
        ([("sink.0.type", "ros")], "at sink.0.type: no sink type 'ros'; there is: "),
        ([("sink.0.file", "a.npz")], "at sink.0.type: no sink type ''; there is: "),
        ([("sink.0.type", "zmq")], "at sink.0.address: missing; a zmq sink needs it"),
        (
            [("sink.0.type", "npz"), ("sink.0.file", "a.npz"), ("sink.0.queue", "3")],
            "at sink.0.queue: a npz sink has only: file",
        ),
        (
            [("sink.0.type", "npz"), ("sink.0.file", "a.aedat4")],
            "at sink.0.file: 'a.aedat4' does not end in .npz",
        ),
        (
            [("record", "a.npz"), ("sink.0.type", "npz"), ("sink.0.file", "./a.npz")],
            "two sinks record to '",
        ),
        (
            [("record", "a.npz"), ("report", "./a.npz")],
            "at report: './a.npz' is the recording or an input of this run",
        ),
        (
            [("record", "a.csv"), ("sensor.aps.enabled", "true")],
            "at sensor.aps.enabled: 'a.csv' cannot hold frames; record to .aedat4 or .npz, or",
        ),
        (
            [("record", "a.raw"), ("sensor.imu.enabled", "true")],
            "at sensor.imu.enabled: 'a.raw' cannot hold IMU samples; record to .aedat4",
        ),
        ([("report", "x.xml")], "at report: 'x.xml' is the recording or an input of this run"),
        (
            [("scene.control_file", "c.npz"), ("record", "c.npz")],
            "'c.npz' is an input of this run; record to another file",
        ),
    ],
)
def test_what_does_not_exist_is_refused_with_what_does(
    overrides: list[tuple[str, str]], said: str
) -> None:
    assert refused(*overrides).startswith(said)


def test_a_report_through_a_link_is_seen_and_the_pipeline_itself_is_safe(tmp_path: Path) -> None:
    file = tmp_path / "p.toml"
    file.write_text('[scene]\nfile = "a.xml"\n')
    (tmp_path / "link.json").symlink_to(file)
    with pytest.raises(EvsError, match="the report would overwrite it"):
        load(str(file), [("report", str(tmp_path / "link.json"))])
    load(str(file), [("record", str(tmp_path / "a.npz")), ("report", str(tmp_path / "a.json"))])


def test_an_error_in_a_file_names_the_file(tmp_path: Path) -> None:
    file = tmp_path / "typo.toml"
    file.write_text("[render]\nsppp = 1\n")
    with pytest.raises(EvsError, match=re.escape(f"{file}: at render.sppp: unknown key")):
        load(str(file), SCENE)


def test_a_run_without_a_scene_is_refused_with_the_fix() -> None:
    with pytest.raises(EvsError, match="--scene"):
        load(None, [])


def test_pipelines_are_found_by_path_or_by_the_name_of_one_of_ours(tmp_path: Path) -> None:
    assert find_pipeline("default") == PIPELINES / "default.toml"
    (tmp_path / "mine.toml").write_text("")
    assert find_pipeline(str(tmp_path / "mine.toml")) == tmp_path / "mine.toml"
    for word, said in (
        ("defualt", "evs itself comes with: default"),
        ("robot.xml", "--scene robot.xml"),
        (str(tmp_path), "is a folder"),
        ("no\0name", "no pipeline file"),
        ("render.spp", "give it as render.spp=VALUE"),
    ):
        with pytest.raises(EvsError, match=re.escape(said)):
            find_pipeline(word)


@pytest.mark.parametrize("file", sorted(PIPELINES.glob("*.toml")), ids=lambda file: file.stem)
def test_every_pipeline_that_comes_with_evs_loads(file: Path) -> None:
    load(str(file), [("scene.file", "x.xml")])


def test_the_default_pipeline_tells_every_key_and_its_default() -> None:
    text = (PIPELINES / "default.toml").read_text()
    # where they differ: python -m evs.drivers.run.config_reference > config/pipelines/default.toml
    assert text == default_pipeline(PipelineConfig)
    # what is shown as an example is possible
    shown = decoding.build(PipelineConfig, tomllib.loads(re.sub(r"(?m)^# (?=\w+ = |\[)", "", text)))
    for place, sink in enumerate(shown.sink[1:]):
        sink.check(f"sink.{place}")
    # commented keys have no default or are examples; a key is told by its line
    told = set()
    table = ""
    for line in text.splitlines():
        if header := re.fullmatch(r"#? ?\[+([\w.]+)\]+", line.strip()):
            table = header[1]
        elif key := re.match(r"#? ?(\w+) = ", line):
            told.add(f"{table}.{key[1]}".lstrip("."))
    wanted = {
        key.name.replace(".N.", ".") for table in describe(PipelineConfig) for key in table.keys
    }
    assert told == wanted
    assert decoding.build(PipelineConfig, tomllib.loads(text)) == (PipelineConfig())


def test_every_sink_is_made_unopened(tmp_path: Path) -> None:
    tables = (
        SinkConfig.of(type="zmq", address="tcp://127.0.0.1:0", wait_for=1, wait_s=0.5, queue=7),
        SinkConfig.of(type="aedat4", file=str(tmp_path / "a.aedat4"), compression="zstd"),
        SinkConfig.of(type="npz", file=str(tmp_path / "a.npz")),
    )
    sinks = [make_sink(table) for table in tables]
    assert [type(sink).__name__ for sink in sinks] == [
        "Publisher",
        "Aedat4Recorder",
        "NpzRecorder",
    ]
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(EvsError, match="compression"):
        make_sink(SinkConfig.of(type="aedat4", file="a.aedat4", compression="lzma"))


def test_presets_want_a_scene_and_nothing_else() -> None:
    assert tuple(pipelines())[: len(PRESETS)] == PRESETS
    for name in PRESETS:
        config = load(name, SCENE)
        # they say how light becomes events, and nothing of where and what for
        tables = decoding.read_toml(pipelines()[name])
        assert set(tables) <= {"render", "model", "sensor"}
        assert set(tables.get("sensor", {})) <= {"photocurrent_pa"}
        assert config.scene.file == "x.xml"
        with pytest.raises(EvsError, match="no scene: give --scene"):
            load(name)
    with pytest.raises(EvsError, match="no pipeline file 'acurate'; evs itself comes with: acc"):
        load("acurate", SCENE)


def test_what_a_pipeline_is_for_stands_at_its_head(tmp_path: Path) -> None:
    for name, file in pipelines().items():
        assert 10 < len(about(file)) < 110, name
        assert not about(file).startswith("[")
    (tmp_path / "mine.toml").write_text("# One thing\n# over two lines. And another\nseed = 1\n")
    assert about(tmp_path / "mine.toml") == "One thing over two lines"
    (tmp_path / "bare.toml").write_text("seed = 1\n")
    assert about(tmp_path / "bare.toml") == ""


def test_help_tells_every_pipeline(capsys: pytest.CaptureFixture[str]) -> None:
    from evs.launch.main import main

    with pytest.raises(SystemExit):
        main(["emulate", "--help"])
    told = capsys.readouterr().out
    for name, file in pipelines().items():
        assert f"  {name:12s}{about(file)}\n" in told
