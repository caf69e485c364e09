"""Training data of randomised sensors: another noisy sensor in each scene, on record."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import evs
from evs.launch.main import main
from evs.msgs import EvsError
from evs_lab.training.make import make_shard
from evs_lab.training.settings import DataSettings, Variant, claim_folder, read_settings
from evs_lab.training.shards import ARRAYS, Shards, describe, read_meta, read_shard, write_shard
from evs_lab.training.targets import NOISY, event_counts
from reference.shards import synthetic_shard

RANGES = {
    "pos_thres": "uniform(0.01, 0.05)",
    "neg_thres": "uniform(0.9, 1.1) * pos_thres",
    "shot_noise_rate_hz": "log_uniform(100, 10000)",
}
TINY = DataSettings(seed=4, pixels=8, truth_spp=8, ticks=14, variants=(Variant(1, "fixed"),))
RANGED = dataclasses.replace(TINY, randomise=RANGES)


def test_a_shard_has_the_noisy_sensor_of_its_number_and_says_so() -> None:
    plain, ranged = make_shard(TINY, 7), make_shard(RANGED, 7)
    changed = [
        name for name in ARRAYS if getattr(plain, name).tobytes() != getattr(ranged, name).tobytes()
    ]
    assert changed == ["noisy_counts"]
    record = ranged.meta["randomised"]
    assert (record["seed"], record["episode"]) == (4, 7)
    assert evs.SensorRanges(RANGES, NOISY).draw(4, 7).values == record["values"]
    # what is on record gives the counts again
    attempt = ranged.meta["scene"]["attempt"]
    seed = int(np.random.SeedSequence([4, 3, 7, attempt, 3]).generate_state(1, np.uint64)[0])
    sensor = evs.sensor_with_values(NOISY, record["values"])
    again = event_counts(ranged.truth, ranged.phase, sensor, seed=seed)
    np.testing.assert_array_equal(again, ranged.noisy_counts)
    assert ranged.noisy_counts.sum() > 20
    assert ranged.meta["settings"]["randomise"] == RANGES
    assert "randomised" not in plain.meta


def test_settings_with_ranges_are_written_and_compared(tmp_path: Path) -> None:
    claim_folder(tmp_path / "a", RANGED)
    assert read_settings(tmp_path / "a") == RANGED
    claim_folder(tmp_path / "a", RANGED)
    with pytest.raises(EvsError, match=r"other settings \(randomise .*, not none\); give those"):
        claim_folder(tmp_path / "a", TINY)
    # data without ranges are as they were before there were any
    assert "randomise" not in TINY.plain()
    claim_folder(tmp_path / "b", TINY)
    with pytest.raises(EvsError, match=r"other settings \(randomise none, not "):
        claim_folder(tmp_path / "b", RANGED)
    for bad in ([], {"pos_thres": 3}):
        (tmp_path / "b" / "data.json").write_text(json.dumps({**TINY.plain(), "randomise": bad}))
        with pytest.raises(EvsError, match="does not hold settings of training data"):
            read_settings(tmp_path / "b")


def test_mistakes_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for word, says in (
        ("pos_thrs=uniform(1, 2)", "at randomise.pos_thrs: no numeric key of [sensor]"),
        ("pos_thres=0.3", "is no distribution"),
        ("sensor.pos_thres=0.3", "at randomise.sensor.pos_thres: no numeric key"),
        ("uniform", "no file 'uniform'"),
    ):
        assert main(["train", "data", str(tmp_path / "a"), "--randomise", word]) == 2
        told = capsys.readouterr().err
        assert says in told
        assert told.count("\n") == 1
    assert not (tmp_path / "a").exists()


def test_the_command_takes_a_file_and_words(tmp_path: Path) -> None:
    file, folder = tmp_path / "ranges.toml", tmp_path / "data"
    file.write_text("[randomise]\npos_thres = 'uniform(0.1, 0.2)'\ncutoff_hz = 'uniform(50, 60)'\n")
    words = ["--randomise", str(file)]
    words += ["--randomise", "cutoff_hz=none", "--randomise", "dark_lux=uniform(0.01,1)"]
    size = ["--pixels", "2", "--ticks", "4", "--truth-spp", "1", "--scenes", "1", "--from", "7"]
    assert main(["train", "data", str(folder), *size, *words, "--quiet"]) == 0
    assert set(read_settings(folder).randomise) == {"pos_thres", "dark_lux"}
    values = read_meta(folder / "00007.npz")["randomised"]["values"]
    assert 0.1 <= values["pos_thres"] <= 0.2
    assert 0.01 <= values["dark_lux"] <= 1


def synthetic(folder: Path) -> Path:
    """Two scenes, one of them held out."""
    variants = (Variant(4, "fixed"), Variant(4, "fresh"))
    settings = DataSettings(pixels=32, ticks=80, variants=variants, randomise=RANGES)
    claim_folder(folder, settings)
    for number in (0, 1):
        shard = synthetic_shard(number, 32, 80, variants)
        drawn = settings.draw(number)
        assert drawn is not None
        meta = {**shard.meta, "settings": settings.plain(), "randomised": drawn.record}
        write_shard(folder / f"{number:05d}.npz", dataclasses.replace(shard, meta=meta))
    return folder


def test_the_description_has_the_values_that_were_drawn(tmp_path: Path) -> None:
    folder = synthetic(tmp_path / "data")
    found = [
        read_shard(folder / name).meta["randomised"]["values"]
        for name in ("00000.npz", "00001.npz")
    ]
    lines = dict(describe(Shards(folder)))
    low, high = sorted(values["pos_thres"] for values in found)
    assert lines["noisy pos_thres"].startswith(f"{low:g} ... {high:g}, mean")


def test_the_report_of_a_training_has_ranges_and_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = synthetic(tmp_path / "data"), tmp_path / "out"
    words = ["--name", "small", "--steps", "1", "--batch", "32", "-o", str(out)]
    assert main(["train", "fit", str(folder), "--recipe", "evsnet_c4", "--spp", "4", *words]) == 0
    assert "only --noisy-truth learns" in capsys.readouterr().out
    data = json.loads((out / "small.training.json").read_text())["data"]
    assert data["randomise"] == RANGES
    for number in (0, 1):
        record = read_meta(folder / f"{number:05d}.npz")["randomised"]
        assert data["randomised"][str(number)] == record
