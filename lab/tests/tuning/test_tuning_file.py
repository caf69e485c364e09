"""The pipeline file that tuning writes: it loads as what was chosen, from where it lies."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from evs.drivers.run.config import PIPELINES, PipelineConfig, load
from evs.msgs import EvsError
from evs_lab.sweep.pareto_front import DEFAULT
from evs_lab.tuning.base_pipeline import base_pipeline
from evs_lab.tuning.pipeline_file import FIRST, check_own, pipeline_text
from evs_lab.tuning.search import CandidateResult, SearchResult, TuningGoal
from evs_lab.tuning.space import Candidate, candidates
from evs_lab.tuning.summary import facts, table

SCENE = str(PIPELINES.parent / "scenes" / "pendulum.xml")


def written(config: PipelineConfig, file: Path) -> PipelineConfig:
    """As it comes back from the file."""
    file.write_text(pipeline_text(config, file, ["evs tune", "goal: a long line " + 60 * "and "]))
    lines = file.read_text().splitlines()
    assert lines[0] == f"{FIRST}: evs tune"
    assert all(len(line) <= 96 for line in lines if line.startswith("#"))
    return load(str(file))


@pytest.mark.parametrize("one", candidates()[::17], ids=str)
def test_every_candidate_comes_back(one: Candidate, tmp_path: Path) -> None:
    base = base_pipeline(SCENE, [("sensor.preset", "ideal"), ("camera.azimuth", "30")])
    config = base.with_settings(one.settings)
    assert written(config, tmp_path / "tuned.toml") == config
    assert config.render.samples == one.spp
    assert config.scene.tick_us == one.tick_us


def test_everything_that_a_pipeline_can_say_comes_back(tmp_path: Path) -> None:
    keys = [
        ("name", 'a "name" with \\ and \u00e9'),
        ("duration_s", "2.5"),
        ("sensor.readout.roi", "1,2,3,4"),
        ("sensor.biases.bias_fo", "-20"),
        ("sensor.preset", "imx636"),
        ("sensor.imu.enabled", "true"),
        ("sensor.aps.bits", "16"),
        ("camera.lookat", "0,0,1"),
        ("render.flicker.0.hz", "60"),
        ("render.flicker.1.light", "lamp"),
        ("loop.max_s", "none"),
        ("sink.0.type", "zmq"),
        ("sink.0.address", "tcp://127.0.0.1:0"),
        ("sink.1.type", "npz"),
        ("sink.1.file", str(tmp_path / "a.npz")),
        ("publish_allow", "k" * 40),
        ("publish", "tcp://127.0.0.1:0"),
        ("publish_key", str(tmp_path / "x.key")),
    ]
    config = base_pipeline(SCENE, keys).config
    assert written(config, tmp_path / "tuned.toml") == config


def test_paths_are_told_from_where_the_file_lies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "models" / "a.xml").write_text(Path(SCENE).read_text())
    monkeypatch.chdir(tmp_path)
    config = base_pipeline("models/a.xml", [("scene.control_file", "c.npy")]).config
    found = written(config, Path("out/tuned.toml"))
    assert 'file = "../models/a.xml"' in Path("out/tuned.toml").read_text()
    assert Path(found.scene.file).resolve() == tmp_path / "models" / "a.xml"
    assert Path(found.scene.control_file).resolve() == tmp_path / "c.npy"
    monkeypatch.chdir(tmp_path / "models")
    assert Path(load("../out/tuned.toml").scene.file).resolve() == tmp_path / "models" / "a.xml"


def test_what_somebody_else_wrote_is_not_written_over(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    check_own(file)
    file.write_text("seed = 1\n")
    with pytest.raises(EvsError, match="was not written by evs tune; give another with -o"):
        check_own(file)
    file.write_text(pipeline_text(PipelineConfig(), file, ["x"]))
    check_own(file)


def test_a_pipeline_its_keys_and_a_robot_are_taken_too(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f'[scene]\nfile = "{SCENE}"\n[render]\nspp = 2\nheadlight = "off"\n')
    base = base_pipeline(str(file), [("model.name", "plain"), ("sensor.preset", "ideal")])
    # only what the command line says stays
    assert base.pinned == {"model.name": "plain"}
    assert base.config.render.headlight == "off"
    tuned = base.with_settings(candidates(base.pinned)[0].settings)
    assert tuned.render.headlight == "off"
    assert tuned.sensor.preset == "ideal"
    # what stays is not set anew, and a key at `none` says nothing
    kept = base_pipeline(
        SCENE, [("model.name", "evsnet"), ("model.chunk", "16"), ("render.spp", "none")]
    )
    assert kept.pinned == {"model.name": "evsnet", "model.chunk": 16}
    assert kept.with_settings(candidates(kept.pinned)[0].settings).model.chunk == 16
    with pytest.raises(EvsError, match=r"no scene: give one, as in evs tune robot\.xml"):
        base_pipeline(None)
    with pytest.raises(EvsError, match="no scene: fast needs one"):
        base_pipeline("fast")
    with pytest.raises(EvsError, match="no robot 'gymnasium/ent'; there is: gymnasium/ant"):
        base_pipeline("gymnasium/ent")
    with pytest.raises(EvsError, match="only an open loop is tuned"):
        base_pipeline(SCENE, [("pace", "lockstep")])


def outcome(rtf: float, error: float, measured: bool = True, **more: float) -> CandidateResult:
    one = candidates()[0]
    return dataclasses.replace(CandidateResult(one, rtf, error, measured), **more)


def test_the_words_say_what_was_predicted_measured_and_what_more_would_cost() -> None:
    winner = outcome(1.25, 0.08, predicted_rtf=1.0, predicted_error=0.1)
    found = SearchResult(TuningGoal(rtf=1.0), winner, True, False, outcome(0.5, 0.04, False),
                  None, [winner, outcome(2.0, 0.2)])  # fmt: skip
    told = dict(facts(found, DEFAULT, 0.004, 61.4))
    assert told["goal"] == "real-time factor of at least 1; reached"
    assert told["real-time factor"] == "1.25 measured (1 predicted)"
    assert told["error"].startswith("0.08 measured (0.1 predicted); share of events")
    assert told["reference's own"].startswith("0.004")
    assert (
        "error 0.04 (0.5 of this), real-time factor 0.5 (0.4 of this), predicted"
        in (told["less error"])
    )
    assert told["more speed"] == "none of those that can be tuned"
    assert told["measured"] == "2 configurations in 61 s; predictions were wrong by at most 25 %"
    assert "--budget ended" in told["not verified"]
    assert [row[1:] for row in table(found)] == [("1.25", "1", "0.08", "0.1"),
                                                 ("2", "-", "0.2", "-")]  # fmt: skip
    plain = dict(facts(dataclasses.replace(found, verified=True, measured=[outcome(2.0, 0.2)],
                                           reached=False), DEFAULT, 0.0, 1.0))  # fmt: skip
    assert "not verified" not in plain
    assert "tick" not in told
    late = dataclasses.replace(
        winner, candidate=dataclasses.replace(winner.candidate, tick_us=4000)
    )
    slow = dict(facts(dataclasses.replace(found, winner=late), DEFAULT, 0.0, 1.0))
    assert slow["tick"].startswith("4 ms, so events come that late")
    assert plain["goal"].endswith("NOT reached")
