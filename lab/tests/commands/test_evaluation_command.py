"""`evs evaluate` end to end on a tiny scene: table, JSON, picture, cache, and what it refuses."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import evs
from evs.emulator.evsnet.export import export
from evs.launch.main import main
from evs.msgs import EvsError
from evs_lab.evaluation import clip, models, scenes, table
from evs_lab.evaluation import evaluate as whole
from evs_lab.evaluation.clip_light import LightSpec
from evs_lab.evaluation.light_cache import LightCache
from reference.judged import written
from reference.networks import random_network

TINY = ["--spp", "1,2", "--ticks", "8", "--pixels", "24", "--reference-spp", "4"]
SIZE = (48, 36)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return written(tmp_path, repeat=1)


@pytest.fixture
def one_patch(monkeypatch: pytest.MonkeyPatch) -> None:
    """The patch lies at one place, whether the camera stands or pans."""
    monkeypatch.setattr(clip, "busiest_corner", lambda *_: (32, 16))


def tiny(scene: Path, **given: Any) -> whole.EvaluationSettings:
    settings = whole.EvaluationSettings(
        (str(scene),), ("still", "pan"), (2,), ("plain", "adaptive"), ticks=6, pixels=24,
        reference_spp=4, threads=1, size=SIZE, patch_px=8,
    )  # fmt: skip
    return replace(settings, **given)


def judge(settings: whole.EvaluationSettings, cache: LightCache) -> whole.Evaluation:
    judged, _ = models.models_under_test(
        settings.models, None, models.RuntimeOptions(1, "reference")
    )
    return whole.evaluate(settings, cache, judged)


def without_times(found: whole.Evaluation) -> list[Any]:
    """Every cell, None for NaN, so that two of them can be equal."""
    cells = [replace(c, measures=replace(c.measures, ms_per_tick=0.0)) for c in found.cells]
    return [table.finite(asdict(one)) for one in cells]


def test_command_json_and_picture(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["evaluate", "--scenes", str(scene), "--models", "plain,adaptive", *TINY,
             "--cache", str(tmp_path / "cache")]  # fmt: skip
    out = [tmp_path / name for name in ("t.json", "t.md", "t.png")]
    files = [f"--{what}={path}" for what, path in zip(("json", "markdown", "picture"), out,
                                                      strict=True)]  # fmt: skip
    assert main([*words, *files]) == 0
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "")
    told = json.loads(out[0].read_text())
    assert set(told) == {"command", "settings", "versions", "left_out", "check", "takes", "rows",
                         "verdict", "winners", "cells"}  # fmt: skip
    assert told["check"] is None
    # two cameras; half the reference, nothing; two models on direct, 3 hybrid and 3 times 1, 2 spp
    assert len(told["cells"]) == len(told["rows"]) == 2 * (2 + 2 * 10)
    assert {clip["camera"] for clip in told["takes"]} == {"still", "pan"}
    assert told["settings"]["reference_spp"] == 4
    assert told["command"].endswith(
        f"evaluate --scenes {scene} --spp 1,2 --models plain,adaptive --ticks 8 --pixels 24 "
        f"--reference-spp 4 --json {out[0]} --markdown {out[1]} --picture {out[2]}"
    )
    page = out[1].read_text()
    for light in ("direct, 4 spp", "hybrid, 4 spp", "hybrid, 16 spp", "hybrid, 16 spp at edges"):
        assert f"\n| pan | {light} | plain |" in page
    assert f"    {told['command']}\n" in page
    assert page.count("\n| still | ") == page.count("\n| pan | ") == 10 + 2 * 22
    with Image.open(out[2]) as image:
        picture = np.asarray(image.convert("RGB"))
    assert picture.shape[1] == 2 * 640
    assert np.count_nonzero(picture.max(2) - picture.min(2) > 60) > 200

    # again: nothing is traced, and the table is on stdout
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").iterdir()}
    assert main([*words, "--json", str(out[0])]) == 0
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").iterdir()} == before
    assert "| camera | light | model | EMD |" in capsys.readouterr().out
    again = json.loads(out[0].read_text())
    for cell in (*told["cells"], *again["cells"]):
        del cell["measures"]["ms_per_tick"]
    assert again["cells"] == told["cells"]


@pytest.mark.usefixtures("one_patch")
def test_the_cache_serves_what_is_the_same_and_nothing_else(scene: Path, tmp_path: Path) -> None:
    settings = tiny(scene, cameras=("still",))
    cache = LightCache(tmp_path / "cache")
    first = judge(settings, cache)
    # two halves; fixed, fresh, and the ticks before; cycle; direct; three of hybrid
    assert (cache.hits, cache.misses) == (0, 10)
    again = judge(settings, cache)
    assert (cache.hits, cache.misses) == (10, 10)
    assert without_times(again) == without_times(first)
    for change, misses in (
        ({"models": ("plain",)}, 0),
        ({"spp": (2, 3)}, 4),
        ({"reference_spp": 6}, 2),
        ({"pixels": 25}, 10),
        # a take begins as it did, and so does what came before
        ({"ticks": 7}, 9),
        ({"seed": 1}, 10),
        ({"cameras": ("pan",)}, 9),
    ):
        before = cache.misses
        judge(replace(settings, **change), cache)  # type: ignore[arg-type]
        assert cache.misses - before == misses, change


@pytest.mark.usefixtures("one_patch")
def test_interrupted_it_keeps_what_was_traced(scene: Path, tmp_path: Path) -> None:
    settings = tiny(scene)
    cache = LightCache(tmp_path / "cache")
    judged, _ = models.models_under_test(("plain",), None, models.RuntimeOptions(1, "reference"))
    # both halves of the first take are done, its first noisy light is not
    most = settings.reference_spp * settings.ticks + 3

    def moved(done: int, _what: str) -> None:
        if done >= most:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        whole.evaluate(settings, cache, judged, moved)
    assert len(list(cache.folder.iterdir())) == 2
    found = whole.evaluate(settings, cache, judged)
    # and what lies before the second camera's take, which begins as the first's does
    assert cache.hits == 3
    assert without_times(found) == without_times(
        whole.evaluate(settings, LightCache(tmp_path / "other"), judged)
    )


def test_progress_ends_where_it_was_said(scene: Path, tmp_path: Path) -> None:
    settings = tiny(scene)
    how = models.RuntimeOptions(1, "reference")
    late = models.network(random_network(3, 2, 8, look_ahead=3), how)
    judged = [*models.models_under_test(("plain",), None, how)[0], late]
    ahead = whole.look_ahead(judged)
    assert ahead == 72
    seen: list[int] = []
    for _ in range(2):
        seen.clear()
        cache = LightCache(tmp_path / "cache")
        found = whole.evaluate(settings, cache, judged, lambda done, _: seen.append(done))
        assert seen == sorted(seen)
        assert seen[-1] == whole.work(settings, ahead)
    assert {c.model for c in found.cells} == {"reference", "nothing", "plain", "random3"}


def test_what_the_rows_say(scene: Path, tmp_path: Path) -> None:
    """At many samples plain is close to the reference; silence misses everything."""
    settings = tiny(scene, cameras=("pan",), spp=(1, 64), ticks=40, reference_spp=256, pixels=200)
    found = judge(settings, LightCache(tmp_path))
    rows = {(row.model, row.spp, row.seeds): row.values for row in found.rows}
    silent, own = rows["nothing", 0, "fixed"], rows["reference", 128, "fixed"]
    assert silent["recall"].mean == 0.0
    few, many = rows["plain", 1, "fresh"], rows["plain", 64, "fresh"]
    assert own["emd"].mean < many["emd"].mean < few["emd"].mean
    assert many["precision"].mean > few["precision"].mean
    clips = found.clips[0]
    assert clips.reference_events > 50
    assert clips.soft


def test_light_is_that_of_whole_pictures(scene: Path, tmp_path: Path) -> None:
    """What is cached are the renderer's own pixels."""
    from evs_lab.evaluation.clip import make_clip
    from evs_lab.evaluation.clip_light import light_of, renderer_of

    clip = make_clip(scenes.scene_setup(str(scene)), "slide", 3, sampled=20, patch_px=8, size=SIZE)
    spec = LightSpec("path", 2, "fresh")
    light = light_of(clip, "mark", spec, 3, LightCache(tmp_path), 1, lambda _: None)
    renderer = renderer_of(clip, spec, 1)
    x, y = clip.pixels.T
    for k, shot in enumerate(clip.instants):
        assert np.array_equal(light[k], renderer.render(*shot)[y, x])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--scenes", "gymnasium/humanoit"], "scene 'gymnasium/humanoit': no scene file"),
        (["--scenes", "nowhere.xml"], "no scene file 'nowhere.xml'"),
        (["--scenes", "no_such_package:a.xml"], "no Python package 'no_such_package' here"),
        (
            ["--scenes", "procedural/x"],
            "scene 'procedural/x': give procedural/0 ... procedural/999",
        ),
        (["--scenes", ","], "no scene is given"),
        (["--scenes", "a,a"], "scene 'a' is given twice"),
        (["--models", "evsnet_c9"], "no model 'evsnet_c9'; there is: evsnet_c"),
        (["--models", "plain,plain"], "a model is given twice"),
        (["--models", ","], "no model is given"),
        (["--cameras", "pann"], "no camera motion 'pann'; there is: pan"),
        (["--spp", "4,four"], "--spp is '4,four': give whole numbers"),
        (["--spp", "0"], "spp is 0; give"),
        (["--reference-spp", "5"], "the reference of 5 spp cannot be halved"),
        (["--ticks", "2"], "ticks is 2; give 3"),
        (["--pixels", "20000"], "pixels is 20000; give"),
        (["--events-per-tick", "few"], "no number of events per tick 'few'; there is: "),
        (["--picture", "x.gif"], "--picture is 'x.gif': end it in .png"),
        (["--json", "nowhere/x.json"], "there is no folder 'nowhere'"),
        (["mine.onnx"], "mine.onnx"),
    ],
)
def test_bad_words_are_one_line(
    words: list[str],
    says: str,
    scene: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    given = [] if "--scenes" in words else ["--scenes", str(scene)]
    given += [] if "--models" in words else ["--models", "plain"]
    assert main(["evaluate", *given, *words, "--cache", str(tmp_path / "cache")]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert says in said.err
    assert list(folder.iterdir()) == []


def test_a_package_that_is_missing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(scenes.FOLDERS, "no_such_robots", "suite")
    words = ["evaluate", "--scenes", "no_such_robots/walker", "--models", "plain"]
    assert main([*words, "--cache", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "no Python package 'no_such_robots' here; pip install no_such_robots" in said


def test_networks_that_do_not_come_with_evs_are_left_out(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(models, "network_names", list)
    words = ["evaluate", "--scenes", str(scene), "--models", "plain,evsnet_c4", "--cameras", "pan"]
    assert main([*words, *TINY, "--cache", str(tmp_path / "cache")]) == 0
    said = capsys.readouterr()
    assert said.err == ("evs: warning: no network 'evsnet_c4' in config/networks: it is left out\n")
    assert "- no network 'evsnet_c4' in config/networks: it is left out" in said.out


def test_two_models_of_one_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "read_network", lambda path: random_network(1))
    with pytest.raises(EvsError, match="two models are called 'plain'"):
        models.models_under_test(
            ("plain",), tmp_path / "plain.onnx", models.RuntimeOptions(1, "reference")
        )
    (found, own), _ = models.models_under_test(
        ("plain",), tmp_path / "mine.onnx", models.RuntimeOptions(1, "reference")
    )
    assert (found.name, own.name) == ("plain", "mine")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in scenes.QUICK else pytest.mark.slow)
     for name in scenes.DEFAULT],
)  # fmt: skip
def test_every_scene_of_the_table_can_be_filmed(
    name: str, robot_files: dict[str, Path], tmp_path: Path
) -> None:
    """Where its package is installed; robots' lamps have a size, and something moves."""
    if name not in robot_files and not name.startswith("procedural/"):
        with pytest.raises(EvsError, match="no Python package 'dm_control' here"):
            scenes.scene_setup(name)
        return
    settings = tiny(Path(name), cameras=("still",), ticks=30, pixels=200, reference_spp=2)
    found = judge(replace(settings, scenes=(name,)), LightCache(tmp_path))
    assert found.clips[0].soft or name.startswith("procedural/")
    assert found.clips[0].reference_patch_events > 0


def test_a_users_own_network_is_judged_besides(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = export(random_network(4, 2), tmp_path / "mine.onnx")
    words = ["evaluate", str(path), "--scenes", str(scene), "--models", "plain", "--cameras", "pan"]
    out = tmp_path / "t.json"
    assert main([*words, *TINY, "--cache", str(tmp_path / "cache"), "--json", str(out)]) == 0
    said = capsys.readouterr()
    assert said.out.count("| mine |") == 1 + 2 * 10
    # it was checked first
    assert said.out.index("| random4 | found | |") < said.out.index("| camera | light | model |")
    assert "| X = 0 | the current is exactly 0" in said.out
    told = json.loads(out.read_text())
    assert told["check"]["name"] == "random4"
    assert told["settings"]["network"] == str(path)
    assert {row["model"] for row in told["rows"]} == {"reference", "nothing", "plain", "mine"}


def test_a_network_of_other_ticks_is_told_before_anything_is_traced() -> None:
    weights = replace(random_network(4, 2), tick_us=500)
    with pytest.raises(EvsError, match="is for ticks of 500 us; here they have 1000 us"):
        models.network(weights, models.RuntimeOptions(1, "reference"), "mine")
    with pytest.raises(EvsError, match="no runtime 'nativ'"):
        models.network(random_network(4, 2), models.RuntimeOptions(1, "nativ"), "mine")
    with pytest.raises(EvsError, match=r"^no execution provider 'gpu'; there is: "):
        models.network(random_network(4, 2), models.RuntimeOptions(1, "onnxruntime", "gpu"), "mine")


def test_a_network_that_is_not_sound_is_told_and_judged_all_the_same(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = random_network(4, 2)
    path, sidecar = export(replace(weights, last=np.zeros_like(weights.last)), tmp_path / "d.onnx")
    words = ["evaluate", str(path), "--scenes", str(scene), "--models", "plain", *TINY]
    assert main([*words, "--cameras", "pan", "--cache", str(tmp_path / "cache")]) == 0
    said = capsys.readouterr()
    lines = said.err.splitlines()
    assert f"evs: warning: {path}: latency: no answer to a step of +-0.5" in lines
    assert all(line.startswith(f"evs: warning: {path}: ") for line in lines)
    assert said.out.count("| d |") == 1 + 2 * 10

    # one that cannot be read is not
    sidecar.write_text(sidecar.read_text().replace("threshold = 0.2", "threshold = -0.2"))
    assert main([*words, "--cache", str(tmp_path / "other")]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "threshold is -0.2" in said.err


def test_a_network_is_not_judged_without_onnxruntime(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    network = Path(evs.__file__).parent / "config/networks/paper.onnx"
    assert main(["evaluate", str(network), "--models", "plain", "--quick"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "pip install onnxruntime" in line
    assert "model.runtime=native" in line
