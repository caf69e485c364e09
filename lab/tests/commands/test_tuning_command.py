"""`evs tune`: exit codes, what it prints and writes, and what it refuses."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from evs.drivers.run.config import PIPELINES, load
from evs.launch.main import main
from evs_lab.tuning import measurement
from evs_lab.tuning.space import Candidate

SCENE = str(PIPELINES.parent / "scenes" / "pendulum.xml")


class Known:
    """What each configuration costs and errs is known."""

    reference_error = 0.004

    def rtf(self, one: Candidate) -> float:
        return 4.0 * one.tick_us / 1000 / (one.spp * (3.0 if one.renderer == "path" else 1.0))

    def error(self, one: Candidate) -> float:
        return 0.4 / math.sqrt(one.spp) * (one.tick_us / 1000) ** 0.3

    def seconds(self, one: Candidate, rtf: float) -> float:
        return 0.0


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Nothing is measured, and files are written to a folder of their own."""

    @contextmanager
    def open_measurer(*_given: Any) -> Iterator[Known]:
        yield Known()

    monkeypatch.setattr(measurement, "open_measurer", open_measurer)
    monkeypatch.chdir(tmp_path)


def test_a_goal_that_is_reached(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", SCENE, "--rtf", "1.0", "--sensor", "ideal"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "goal              real-time factor of at least 1; reached\n" in said.out
    assert "written           tuned.toml\n" in said.out
    assert "emulate tuned.toml --record run.aedat4\n" in said.out
    config = load("tuned.toml")
    assert config.sensor.preset == "ideal"
    chosen = Candidate(
        config.render.renderer, config.render.samples, config.render.antialiasing,
        config.render.seeds, config.model.name, config.scene.tick_us, config.threads,
    )  # fmt: skip
    assert Known().rtf(chosen) >= 1.0
    assert Known().error(chosen) <= 0.24
    head = Path("tuned.toml").read_text().splitlines()
    assert head[0].startswith("# Tuned by evs tune: ")
    assert head[0].endswith(f"tune {SCENE} --sensor ideal --rtf 1")
    for name in ("goal", "real-time factor", "error", "less error", "more speed", "measured"):
        assert any(line.startswith(f"# {name}: ") for line in head), name
    # again: our own file may be written over
    assert main(["tune", SCENE, "--error", "0.1", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_the_cores_are_those_that_may_be_used(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 4, 17})
    assert main(["tune", SCENE, "--rtf", "1.0"]) == 0
    assert ", 3 cores\n" in capsys.readouterr().out


def test_a_goal_out_of_reach_writes_only_if_asked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", SCENE, "--rtf", "1e5"]) == 1
    said = capsys.readouterr().out
    assert "goal              real-time factor of at least 100000; NOT reached\n" in said
    assert "found             direct 1, plain, 4 ms" in said
    assert "not written       --anyway writes it as it is\n" in said
    assert "next:" not in said
    assert not Path("tuned.toml").exists()
    assert main(["tune", SCENE, "--rtf", "1e5", "--anyway", "-o", "best.toml"]) == 1
    assert "written           best.toml\n" in capsys.readouterr().out
    assert load("best.toml").render.spp == 1


def test_keys_that_are_given_stay() -> None:
    words = ["render.renderer=path", "scene.tick_us=1000", "model.name=adaptive"]
    assert main(["tune", SCENE, "--error", "0.1", *words, "--quiet"]) == 0
    config = load("tuned.toml")
    assert (config.render.renderer, config.model.name) == ("path", "adaptive")
    assert config.scene.tick_us == 1000
    assert config.render.samples == 16


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "no scene: give one, as in evs tune robot.xml --rtf 1.0"),
        (["a.xml", "b.xml"], "two pipelines, 'a.xml' and 'b.xml'"),
        (["fast"], "no scene: fast needs one beside it, as in scene.file=robot.xml"),
        (["fastt"], "no pipeline 'fastt'; there is: fast"),
        ([SCENE, "render.sppp=1"], "unknown key; nearest known: render.spp"),
        ([SCENE, "render.renderer=raster"], "render.renderer=raster is not tuned; give direct or"),
        (
            [SCENE, "model.name=plainn"],
            "model.name=plainn is not tuned; give adaptive or evsnet or",
        ),
        ([SCENE, "render.seeds=frozen"], "at render.seeds: no seeds 'frozen'"),
        (
            [SCENE, "render.renderer=direct", "model.name=evsnet"],
            "no configuration to tune has render.renderer=direct, model.name=evsnet; leave one",
        ),
        ([SCENE, "--error", "0.1"], "give one goal"),
        ([SCENE, "--budget", "0"], "--budget is 0 s: give more than 0"),
        ([SCENE, "--budget", "inf"], "--budget is inf s: give more than 0, 1e+06 at most"),
        ([SCENE, "-o", "new.xml"], "--output is 'new.xml', a scene by its ending"),
        ([SCENE, "--metric", "edm"], "no figure of error 'edm'; there is: emd"),
        ([SCENE, "-o", "nowhere/t.toml"], "there is no folder 'nowhere'"),
        ([SCENE, "-o", "mine.toml"], "'mine.toml' is there and was not written by evs tune"),
        ([SCENE, "--rft", "1"], "unrecognized arguments: --rft"),
    ],
)
def test_bad_words_are_one_line(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("mine.toml").write_text("seed = 1\n")
    assert main(["tune", *words, "--rtf", "1"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert says in said.err
    assert Path("mine.toml").read_text() == "seed = 1\n"
    assert [path.name for path in Path().iterdir()] == ["mine.toml"]


def test_without_a_goal_the_line_says_both(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", SCENE]) == 2
    assert capsys.readouterr().err == "evs: give one goal: --rtf 1.0 or --error 0.1\n"
