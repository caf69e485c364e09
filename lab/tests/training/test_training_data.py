"""Training data: pixels and light of a scene, and a folder of them that can be continued."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from evs.launch.main import main
from evs.msgs import EvsError
from evs.tools.jobs.ray_node import fingerprint, fingerprint_of, make_on_node
from evs_lab.training import make
from evs_lab.training.make import ShardJob, make_data, make_shard, work_of
from evs_lab.training.pilot import Pilot, choose_pixels
from evs_lab.training.scenes import make_scene
from evs_lab.training.settings import DataSettings, Variant
from evs_lab.training.shards import ARRAYS, Shard, Shards, read_shard
from evs_lab.training.traced_scene import simulate_scene
from reference.shards import synthetic_data, synthetic_shard

TINY = DataSettings(
    seed=4, pixels=8, truth_spp=8, ticks=14, variants=(Variant(1, "fixed"), Variant(1, "fresh"))
)


def same(first: Shard, second: Shard) -> bool:
    return first.meta == second.meta and all(
        getattr(first, name).tobytes() == getattr(second, name).tobytes() for name in ARRAYS
    )


def pilot_of(score: np.ndarray, dn: float = 50.0, px_s: float = 0.0) -> Pilot:
    light = np.full((3, *score.shape), dn, np.float32)
    return Pilot(score, light, np.full_like(light, px_s))


def simulate_one_scene(patch: pytest.MonkeyPatch) -> None:
    """Every scene moves as one that is simulated once: which are taken does not depend on it."""
    traced = simulate_scene(make_scene(TINY.seed, 0), TINY.ticks, TINY.tick_us, 1)
    patch.setattr(make, "simulate_scene", lambda *_: traced)


def trace_nothing(patch: pytest.MonkeyPatch) -> None:
    """Shards hold made-up light, and the settings that they were made with."""

    def shard(settings: DataSettings, number: int, *_: object) -> Shard:
        made = synthetic_shard(number, pixels=settings.pixels, ticks=settings.ticks)
        return dataclasses.replace(made, meta={"settings": settings.plain()})

    patch.setattr(make, "make_shard", shard)


def test_a_node_with_other_sources_of_evs_lab_is_refused() -> None:
    job = ShardJob(DataSettings(), 0)
    wanted = fingerprint_of(job)
    assert {*wanted} - {*fingerprint()} == {"sources of evs_lab"}
    with pytest.raises(EvsError, match=r"^node b has sources of evs_lab \w+ \(here edited\)"):
        next(make_on_node(job, {**wanted, "sources of evs_lab": "edited"}, 1, "b"))


def test_a_shard_follows_from_its_number_on_any_number_of_threads() -> None:
    samples = []
    # the numbers whose first scene is useful
    one = make_shard(TINY, 7, threads=1, moved=samples.append)
    assert sum(samples) == work_of(TINY)
    assert same(one, make_shard(TINY, 7, threads=3))
    assert not same(one, make_shard(TINY, 5))
    assert not same(one, make_shard(dataclasses.replace(TINY, seed=5), 7))
    assert one.meta["settings"] == TINY.plain()
    assert {"kind", "level", "tags", "attempt"} <= set(one.meta["scene"])


def test_still_light_is_still_with_fixed_seeds_and_not_with_fresh_ones() -> None:
    settings = dataclasses.replace(TINY, pixels=60, ticks=10)
    still = moving = 0
    # two scenes of which much stands still
    for number in (1, 3):
        shard = make_shard(settings, number)
        stands = np.all(shard.truth == shard.truth[0], 0)
        fixed, fresh = shard.variant(1, "fixed"), shard.variant(1, "fresh")
        # light that 8 samples do not see change may still change for other ones: shadows, edges
        silent = np.all(fixed == fixed[0], 0)
        still += int(np.sum(silent & stands))
        noisy = np.any(fresh != fresh[0], 0)
        moving += int(np.sum(silent & stands & noisy))
    assert still > 20
    assert moving > 0.5 * still


def test_more_samples_are_nearer_to_the_truth() -> None:
    variants = tuple(Variant(spp, "fresh") for spp in (1, 16))
    settings = dataclasses.replace(TINY, pixels=40, ticks=6, truth_spp=256, variants=variants)
    errors = np.zeros(2)
    for number in range(3):
        shard = make_shard(settings, number)
        lit = shard.truth > 1e-4
        for place in range(2):
            ratio = shard.light[place][lit] / shard.truth[lit]
            errors[place] += np.mean(np.minimum(np.abs(ratio - 1), 1))
    assert errors[1] < 0.6 * errors[0]


def test_half_of_the_pixels_lie_where_light_changes() -> None:
    score = np.zeros((130, 173))
    score[20:40, 60:90] = 3.0
    rng = np.random.default_rng(1)
    pixels = choose_pixels(pilot_of(score), 1000, rng)
    assert pixels.shape == (1000, 2)
    assert len({tuple(pixel) for pixel in pixels.tolist()}) == 1000
    assert pixels.min() >= 0
    assert np.all(pixels < (346, 260))
    inside = score[pixels[:, 1] // 2, pixels[:, 0] // 2] > 0
    # 500 by their score, and of the others the share of the area, 2.7 %
    assert 500 <= inside.sum() <= 530
    left = pixels[~inside]
    assert np.all(np.abs(left.mean(0) - (172.5, 129.5)) < 5 * np.array([346, 260]) / 12**0.5 / 22)


def test_pixels_of_a_higher_score_are_chosen_more_often() -> None:
    score = np.zeros((130, 173))
    score[:, :80], score[:, 80:] = 1.0, 4.0
    pixels = choose_pixels(pilot_of(score), 2000, np.random.default_rng(2))
    right = np.mean(pixels[1000:, 0] >= 160)
    share = 4 * 93 / (4 * 93 + 80)
    assert abs(right - share) < 5 * np.sqrt(share * (1 - share) / 1000)


@pytest.mark.parametrize("moving", [0, 3])
def test_where_too_little_moves_pixels_lie_anywhere(moving: int) -> None:
    score = np.zeros((130, 173))
    score[0, :moving] = 1.0
    pixels = choose_pixels(pilot_of(score), 301, np.random.default_rng(3))
    assert len({tuple(pixel) for pixel in pixels.tolist()}) == 301
    found = {tuple(pixel) for pixel in pixels.tolist()}
    assert {(x, y) for x in range(2 * moving) for y in range(2)} <= found


def test_scenes_of_no_use_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    number = 1
    score = np.full((130, 173), 2.0)
    bad = [pilot_of(score, 0.1), pilot_of(score, 1e5), pilot_of(score, 50.0, 1e5)]
    seen = iter([*bad, pilot_of(score)])
    simulate_one_scene(monkeypatch)
    monkeypatch.setattr(make, "run_pilot", lambda *_: next(seen))
    assert make_shard(TINY, number).meta["scene"]["attempt"] == 3
    monkeypatch.setattr(make, "run_pilot", lambda *_: pilot_of(score, 0.1))
    with pytest.raises(EvsError, match=r"scene 1: none of 20 .*take another seed"):
        make_shard(TINY, number)


def test_few_numbers_may_be_still(monkeypatch: pytest.MonkeyPatch) -> None:
    still = pilot_of(np.zeros((130, 173)))
    seen = []
    monkeypatch.setattr(make, "run_pilot", lambda *_: still)
    monkeypatch.setattr(make, "ATTEMPTS", 1)
    simulate_one_scene(monkeypatch)
    for number in range(60):
        try:
            make_shard(dataclasses.replace(TINY, pixels=1), number)
            seen.append(number)
        except EvsError:
            continue
    # 15 % of 60: 9, with a standard deviation of 2.8
    assert 1 <= len(seen) <= 20


def make_all(folder: Path, stopped=lambda: False, numbers: range = range(3)):
    return make_data(folder, TINY, numbers, 1, lambda *_: None, stopped)


@pytest.mark.slow
def test_an_interrupted_folder_is_continued_with_the_same_bytes(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    told: list[tuple[int, str]] = []
    made = make_data(whole, TINY, range(3), 1, lambda *said: told.append(said), lambda: False)
    assert (made.made, made.kept) == (3, 0)
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1] == (3 * work_of(TINY), "scene 2")

    # a wish to stop is looked at between scenes
    asked = iter([False, True])
    assert make_all(cut, lambda: next(asked)).made == 1
    first = (cut / "00000.npz").stat().st_mtime_ns
    # a process that was killed leaves half a file under another name
    (cut / ".00001.npz.123").write_bytes(b"half")
    again = make_all(cut)
    assert (again.made, again.kept) == (2, 1)
    assert (cut / "00000.npz").stat().st_mtime_ns == first
    for one, other in zip(Shards(whole), Shards(cut), strict=True):
        assert same(one, other)
    # in processes beside each other, to the byte
    made = make_data(tmp_path / "two", TINY, range(3), 0, lambda *_: None, lambda: False, workers=2)
    assert (made.made, made.kept) == (3, 0)
    for name in ("data.json", "00000.npz", "00001.npz", "00002.npz"):
        assert (tmp_path / "two" / name).read_bytes() == (whole / name).read_bytes()
    # in two halves, on two machines
    make_all(tmp_path / "half", numbers=range(2, 3))
    assert same(read_shard(tmp_path / "half" / "00002.npz"), Shards(whole)[2])


def test_shards_that_do_not_belong_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trace_nothing(monkeypatch)
    make_all(tmp_path / "data", numbers=range(1))
    other = dataclasses.replace(TINY, seed=9)
    with pytest.raises(EvsError, match="other settings"):
        make_data(tmp_path / "data", other, range(1), 1, lambda *_: None, lambda: False)
    make_data(tmp_path / "other", other, range(1), 1, lambda *_: None, lambda: False)
    (tmp_path / "other" / "00000.npz").replace(tmp_path / "data" / "00000.npz")
    with pytest.raises(EvsError, match="of other settings than its folder; delete it"):
        make_all(tmp_path / "data")
    (tmp_path / "data" / "00000.npz").write_bytes(b"PK")
    with pytest.raises(EvsError, match="delete it and make it again"):
        make_all(tmp_path / "data")
    for numbers in (range(0), range(-1, 2), range(99_999, 100_001)):
        with pytest.raises(EvsError, match="give at least one"):
            make_all(tmp_path / "none", numbers=numbers)


ARGUMENTS = ["--pixels", "6", "--ticks", "10", "--truth-spp", "4", "--threads", "1"]


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "data")
    assert main(["train", "data", folder, "--scenes", "1", *ARGUMENTS]) == 0
    assert main(["train", "data", "--scenes", "2", folder, *ARGUMENTS]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"{folder}: 1 scenes made, 0 were there",
        f"{folder}: 1 scenes made, 1 were there",
    ]
    shard = Shards(folder)[1]
    assert shard.light.shape == (8, 10, 6)
    assert [(v.spp, v.seeds) for v in shard.variants][::4] == [(1, "fixed"), (1, "fresh")]
    assert main(["train", "data", folder, "--seed", "2", *ARGUMENTS]) == 2
    assert "other settings (seed 1, not 2)" in capsys.readouterr().err


def test_a_folder_is_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = synthetic_data(tmp_path / "made", shards=2, pixels=9, ticks=40)
    assert main(["train", "data", str(folder), "--describe"]) == 0
    told = dict(line.split("  ", 1) for line in capsys.readouterr().out.splitlines())
    counts = np.concatenate([shard.counts.sum((0, 1)) for shard in Shards(folder)])
    assert told["scenes"].split(":")[0].strip() == "2"
    assert told["pixels"].strip() == f"{len(counts)}, each 40 ticks"
    assert told["pixels with events"].strip() == f"{100 * np.mean(counts > 0):.3g} %"
    assert told["events of a pixel"].strip().startswith(f"mean {counts.mean():.4g};")
    assert main(["train", "data", str(tmp_path / "none"), "--describe"]) == 2


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "COMMAND"),
        (["dta"], "dta"),
        (["data"], "DIR"),
        (["data", "x", "--scenes", "0"], "give at least one"),
        (["data", "x", "--pixels", "0"], "pixels is 0"),
        (["data", "x", "--threads", "-1"], "threads is -1"),
        (["data", "x", "--workers", "0"], "workers is 0: give"),
        (["data", "x", "--ray", "auto", "--workers", "2"], "not both"),
        (["data", "x", "--truth-spp", "many"], "truth-spp"),
        (["data", "/dev/null/x"], "cannot write"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line


def test_help_says_what_is_held_out(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["train", "data", "--help"])
    told = " ".join(capsys.readouterr().out.split())
    assert "No scene has a robot" in told


def test_a_full_disk_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    trace_nothing(monkeypatch)
    monkeypatch.setattr(np, "savez_compressed", full)
    assert main(["train", "data", str(tmp_path / "data"), "--scenes", "2", *ARGUMENTS]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "00000.npz: No space left on device; the jobs before it are whole" in line
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["data.json"]


def test_ctrl_c_ends_it_after_the_scene(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    command = [sys.executable, "-m", "evs.launch.main", "train", "data", str(folder)]
    run = subprocess.Popen(
        [*command, "--scenes", "500", *ARGUMENTS], stdout=subprocess.PIPE, env=os.environ
    )
    try:
        ends = time.monotonic() + 60
        while not (folder / "00001.npz").exists() and time.monotonic() < ends:
            time.sleep(0.02)
        run.send_signal(signal.SIGINT)
        told, _ = run.communicate(timeout=60)
    finally:
        run.kill()
    assert run.returncode == 130
    assert b"scenes made" in told
    assert b"give the command again" in told
    shards = Shards(folder)
    assert 2 <= len(list(shards)) < 500
    assert {path.suffix for path in folder.iterdir()} == {".npz", ".json"}
