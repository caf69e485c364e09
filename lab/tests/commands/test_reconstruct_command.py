"""`evs evaluate --reconstruct` on a tiny scene: rows, table, JSON, picture, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import helper
from PIL import Image

from evs.emulator.base.scene import F64
from evs.emulator.sensor.pixel import log_light
from evs.launch.main import main
from evs.msgs import Events, EvsError
from evs_lab.evaluation import models, scenes
from evs_lab.evaluation import reconstruct as video
from evs_lab.evaluation.clip import make_clip
from evs_lab.evaluation.clip_light import LightSpec, renderer_of
from evs_lab.evaluation.light_cache import LightCache
from evs_lab.evaluation.reconstruct_table import summary, video_markdown
from evs_lab.reconstruction import read_video_network
from reference.graphs import graph
from reference.judged import written

SIZE = (48, 36)
WORDS = ["--models", "plain", "--ticks", "41", "--spp", "1", "--reference-spp", "2"]


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return written(tmp_path, repeat=1)


def summing(folder: Path) -> Path:
    """A network that adds up what it receives: image = next0 = state0 + voxels / 8."""
    path = folder / "summing.onnx"
    sides = (1, 1, "H", "W")
    path.write_bytes(
        graph(
            [
                helper.make_node("Mul", ["voxels", "eighth"], ["part"]),
                helper.make_node("Add", ["state0", "part"], ["next0"]),
                helper.make_node("Add", ["next0", "grey"], ["image"]),
            ],
            {"eighth": np.float32([0.125]), "grey": np.float32([0.5])},
            {"voxels": sides, "state0": sides},
            {"image": sides, "next0": sides},
        )
    )
    return path


def tiny(scene: Path, **given: Any) -> video.EvaluationSettings:
    pixels = SIZE[0] * SIZE[1]
    settings = replace(
        video.SETTINGS, scenes=(str(scene),), spp=(2, 4), models=("plain", "adaptive"), ticks=81,
        pixels=pixels, reference_spp=16, size=SIZE, threads=1,
    )  # fmt: skip
    return replace(settings, **given)


def judge(settings: video.EvaluationSettings, cache: Path, network: Path) -> video.VideoEvaluation:
    tested, _ = models.models_under_test(settings.models, None, settings.how)
    opened = read_video_network(network, SIZE[::-1], raw=True, threads=1)
    seen: list[int] = []
    found = video.evaluate_video(
        settings, LightCache(cache), tested, video.reconstructors(settings, opened),
        lambda done, _: seen.append(done),
    )  # fmt: skip
    assert seen == sorted(seen)
    assert seen[-1] == video.work(settings, tested)
    return found


@pytest.mark.slow
def test_command_json_and_picture(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    net, cache = summing(tmp_path), tmp_path / "cache"
    words = ["evaluate", "--scenes", str(scene), *WORDS, "--cache", str(cache)]
    out = tmp_path / "t.json", tmp_path / "t.png"
    files = ["--json", str(out[0]), "--picture", str(out[1])]
    assert main([*words, "--reconstruct", str(net), "--raw-voxels", *files]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    told = json.loads(out[0].read_text())
    assert told["reconstructors"] == ["filter", "summing"]
    assert told["command"].endswith(f"--reconstruct {net} --raw-voxels")
    assert f"    {told['command']}\n" in said.out
    rows = [(cell["light"], cell["model"]) for cell in told["cells"]]
    assert rows == [
        ("16 fixed", "truth"), ("2 fixed", "reference"), ("none", "nothing"),
        ("1 fixed", "plain"), ("1 cycle", "plain"), ("1 fresh", "plain"),
    ]  # fmt: skip
    assert said.out.count(f"\n| {scene} | pan | ") == len(rows)
    # of pictures at 20 and 40 ms, the later half
    assert all(len(cell["measures"]["filter"]["ssim"]) == 1 for cell in told["cells"])
    with Image.open(out[1]) as image:
        assert image.size == (8 + 7 * 136, 2 * (26 + 96 + 20))

    # the filter alone: nothing is traced again, and the numbers are the same
    before = {path: path.stat().st_mtime_ns for path in cache.iterdir()}
    assert main([*words, "--reconstruct", "--json", str(out[0]), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    again = json.loads(out[0].read_text())
    assert {path: path.stat().st_mtime_ns for path in cache.iterdir()} == before
    assert again["reconstructors"] == ["filter"]
    assert [c["measures"]["filter"] for c in again["cells"]] == [
        c["measures"]["filter"] for c in told["cells"]
    ]


@pytest.mark.slow
def test_what_the_rows_say(tmp_path: Path) -> None:
    # a floor with much to see, and time for it to move by some pixels
    settings = tiny(written(tmp_path), ticks=201)
    found = judge(settings, tmp_path / "cache", summing(tmp_path))
    rows = {(cell.model, cell.light): summary(cell) for cell in found.cells}
    assert len(rows) == 3 + 2 * 4
    truth, silent = rows["truth", "128 fixed"], rows["nothing", "none"]
    reference, noisy = rows["reference", "16 fixed"], rows["plain", "2 fresh"]
    for by in ("filter", "summing"):
        assert truth[by]["ssim"] == truth[by]["correlation"] == pytest.approx((1, 0))
        assert silent[by]["correlation"] == silent[by]["lpa"] == (0, 0)
        assert reference[by]["correlation"][0] > 0.3
        assert reference[by]["ssim"][0] > noisy[by]["ssim"][0] > silent[by]["ssim"][0]
        # noise has energy too
        assert noisy[by]["lpa"][0] > reference[by]["lpa"][0] > 0
    hz = {(cell.model, cell.light): cell.events_hz for cell in found.cells}
    assert hz["plain", "2 fresh"] > 2 * hz["reference", "16 fixed"] > 0 == hz["nothing", "none"]


def test_who_knows_the_light_is_right_at_every_time(tmp_path: Path) -> None:
    scene = written(tmp_path)
    settings = tiny(scene, models=("plain",), spp=(1,), reference_spp=2)
    clip = make_clip(
        scenes.scene_setup(str(scene)), "pan", 81, sampled=SIZE[0] * SIZE[1], patch_px=0,
        size=SIZE, pan_px_s=170.0 * SIZE[1] / 260,
    )  # fmt: skip
    renderer = renderer_of(clip, LightSpec("path", 16, seed=2), 1)
    asked: list[Sequence[int]] = []

    def knowing(_events: Events, times_us: Sequence[int]) -> F64:
        asked.append(times_us)
        frames = [renderer.render(*clip.instants[t // 1000]).copy() for t in times_us]
        return log_light(np.stack(frames), models.sensor_of(1)).astype(np.float64)

    tested, _ = models.models_under_test(("plain",), None, settings.how)
    by = [video.Reconstructor("knowing", knowing, video.LOG_STEP)]
    found = video.evaluate_video(settings, LightCache(tmp_path / "cache"), tested, by)
    assert asked == [[20_000, 40_000, 60_000, 80_000]] * 5
    for cell in found.cells:
        assert cell.measures["knowing"].ssim == pytest.approx([1, 1])


def test_a_row_has_the_mean_and_the_deviation_over_the_times() -> None:
    measures = video.PictureMeasures([0.1, 0.3], [-1.0, 1.0], [2.0, 4.0])
    cell = video.VideoCell("one", "pan", "4 fixed", "plain", 2.0, {"net": measures}, {})
    found = video.VideoEvaluation("evs", {}, {}, ["net"], [cell])
    assert summary(cell)["net"]["ssim"] == pytest.approx((0.2, 0.1))
    line = "| one | pan | 4 fixed | plain | 2 | 0.200 ± 0.100 | 0.000 ± 1.000 | 3.00 ± 1.00 |"
    assert video_markdown(found).splitlines()[-1] == line


def test_pictures_are_whole(scene: Path) -> None:
    """Every pixel is traced once, and comes back to its place."""
    setup = scenes.scene_setup(str(scene))
    clip = make_clip(setup, "pan", 2, sampled=SIZE[0] * SIZE[1], patch_px=0, size=SIZE)
    renderer = renderer_of(clip, LightSpec("path", 1), 1)
    values = renderer.trace(*clip.instants[1], clip.pixels)
    made = video.image_of(values, clip.pixels, SIZE)
    assert np.array_equal(made, renderer.render(*clip.instants[1]))
    assert made.shape == (36, 48)


def test_the_pan_turns_as_far_as_on_the_large_picture(scene: Path) -> None:
    """One angle, whatever the size of the picture; tests above have it in px."""
    setup, size = scenes.scene_setup(str(scene)), video.PX
    poses = [
        make_clip(setup, "pan", 2, sampled=9, patch_px=0, size=px, pan_px_s=speed).instants[1][1]
        for px, speed in (((346, 260), 170.0), (size, 170.0 * size[1] / 260))
    ]
    assert poses[0].mat == pytest.approx(poses[1].mat, abs=1e-12)


def test_each_model_gets_the_light_that_it_is_meant_for() -> None:
    tested, _ = models.models_under_test(
        ("plain", "evsnet_c8", "paper"), None, models.RuntimeOptions(1, "reference")
    )
    found = [(one.name, spec.spp, spec.seeds) for spec, one in video.cases(tested, (4, 16))]
    assert found == [
        ("plain", 4, "fixed"), ("plain", 16, "fixed"), ("plain", 4, "cycle"),
        ("plain", 4, "fresh"), ("evsnet_c8", 4, "fresh"), ("evsnet_c8", 16, "fresh"),
        ("paper", 64, "fresh"),
    ]  # fmt: skip
    assert [spec.spp for spec, _ in video.cases(tested[1:], (3, 1000))] == [4, 64, 64]


def test_held_out_scenes_are_no_default() -> None:
    assert not [s for s in video.SETTINGS.scenes if "quadruped" in s or "dog" in s]


def test_too_few_ticks_for_a_picture(scene: Path) -> None:
    assert video.judged_ticks(tiny(scene, ticks=21)) == [20]
    with pytest.raises(EvsError, match="ticks is 20; give 21 or more"):
        video.judged_ticks(tiny(scene, ticks=20))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--reconstruct", "none.onnx"], "cannot read the network none.onnx: No such file"),
        (["--reconstruct", "net.onnx"], "net.onnx: onnxruntime cannot load the network"),
        (["--reconstruct", "--ticks", "20"], "ticks is 20; give 21 or more for a picture"),
        (["--reconstruct", "--pixels", "9"], "--reconstruct needs every pixel"),
        (["--reconstruct", "--raw-voxels"], "--raw-voxels is for a network that makes video"),
        (["--raw-voxels"], "--raw-voxels is for a network that makes video"),
        (["--reconstruct", "--models", "plane"], "no model 'plane'; there is: plain"),
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
    monkeypatch.chdir(tmp_path)
    Path("net.onnx").write_bytes(b"no graph")
    assert main(["evaluate", "--scenes", str(scene), *words, "--cache", "cache"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert says in said.err
