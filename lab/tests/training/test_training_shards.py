"""Shards: what was written is read, what is damaged or of other settings is refused in one line."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evs.msgs import EvsError
from evs_lab.training.settings import (
    SETTINGS_FILE,
    DataSettings,
    Variant,
    claim_folder,
    read_settings,
)
from evs_lab.training.shards import ARRAYS, Shards, read_meta, read_shard, write_shard
from reference.alarm import not_waited_for
from reference.shards import synthetic_data, synthetic_shard


def test_what_was_written_is_read(tmp_path: Path) -> None:
    shard = synthetic_shard(1, pixels=7, ticks=50)
    write_shard(tmp_path / "00003.npz", shard)
    found = read_shard(tmp_path / "00003.npz")
    for name, dtype in ARRAYS.items():
        array = getattr(found, name)
        assert array.dtype == dtype
        np.testing.assert_array_equal(array, getattr(shard, name))
    assert (found.variants, found.meta, found.ticks) == (shard.variants, shard.meta, 50)
    assert read_meta(tmp_path / "00003.npz") == shard.meta
    # nothing else is left in the folder
    assert [path.name for path in tmp_path.iterdir()] == ["00003.npz"]


def test_variants_are_found_by_what_they_are() -> None:
    shard = synthetic_shard(1, pixels=5, ticks=20)
    np.testing.assert_array_equal(shard.variant(4, "fresh"), shard.light[1])
    with pytest.raises(EvsError, match="no light of 16 spp with fixed seeds; there is: 4 fixed"):
        shard.variant(16, "fixed")


def spoilt(shard, name: str, index, value):
    array = getattr(shard, name).copy()
    array[index] = value
    return {name: array}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: {"truth": s.truth.astype(np.float64)}, "truth is float64"),
        (lambda s: {"light": s.light[:1]}, r"light is float32 \(1, 20, 5\)"),
        (lambda s: {"counts": s.counts[0]}, "counts is uint8"),
        (lambda s: {"pixels": s.pixels[:, :1]}, "pixels is int16"),
        (lambda s: spoilt(s, "light", (0, 3, 1), np.nan), "light holds"),
        (lambda s: spoilt(s, "truth", (3, 1), -1.0), "truth holds"),
        (lambda s: spoilt(s, "truth", (3, 1), np.inf), "truth holds"),
        (lambda s: spoilt(s, "phase", 2, 1.0), "phase holds"),
        (lambda s: spoilt(s, "phase", 2, np.nan), "phase holds"),
        (lambda s: spoilt(s, "counts", (0, 0, 2), 1), "tick 0"),
        (lambda s: spoilt(s, "pixels", (2, 0), 346), "outside the image"),
    ],
)
def test_a_shard_that_does_not_fit_itself_is_refused(change, says: str) -> None:
    shard = synthetic_shard(2, pixels=5, ticks=20)
    with pytest.raises(EvsError, match=says):
        dataclasses.replace(shard, **change(shard))


def complaint(path: Path) -> str:
    """What is wrong with a shard; "" where nothing is."""
    try:
        read_shard(path)
    except EvsError as reason:
        return str(reason)
    return ""


def test_damaged_files_are_one_line(tmp_path: Path) -> None:
    path = tmp_path / "00000.npz"
    write_shard(path, synthetic_shard(1, pixels=4, ticks=30))
    whole = path.read_bytes()
    rng = np.random.default_rng(5)
    for cut in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(EvsError, match=r"cannot read .* make it again"):
            read_shard(path)
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        path.write_bytes(bytes(damaged))
        # one bit more or less: refused, or of no account
        assert "\n" not in complaint(path)
    np.save(path.with_suffix(".npy"), np.zeros(3))
    path.with_suffix(".npy").rename(path)
    with pytest.raises(EvsError, match=r"no \.npz file"):
        read_shard(path)
    np.savez(path, light=np.zeros(3))
    with pytest.raises(EvsError, match="no shard of training data: it lacks truth"):
        read_shard(path)
    with pytest.raises(EvsError, match="no shard"):
        read_shard(tmp_path / "00007.npz")


def test_a_folder_lists_its_shards_in_order(tmp_path: Path) -> None:
    folder = synthetic_data(tmp_path / "data", shards=3, pixels=4, ticks=20)
    (folder / ".00009.npz.77").write_bytes(b"half a shard")
    (folder / "00001.npz").rename(folder / "00012.npz")
    shards = Shards(folder)
    assert shards.numbers == (0, 2, 12)
    assert len(shards) == len(list(shards)) == 3
    assert shards.settings.pixels == 4
    np.testing.assert_array_equal(shards[2].truth, synthetic_shard(1, 4, 20).truth)


def test_folders_without_data_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match="no training data in"):
        Shards(tmp_path / "none")
    claim_folder(tmp_path / "new", DataSettings())
    with pytest.raises(EvsError, match="there is no shard in"):
        Shards(tmp_path / "new")
    for text in ("{", "[]", '{"seed": 1}', json.dumps({**DataSettings().plain(), "seed": "1"})):
        (tmp_path / "new" / "data.json").write_text(text)
        with pytest.raises(EvsError, match=r"cannot read|does not hold settings"):
            Shards(tmp_path / "new")


def test_a_folder_keeps_its_settings(tmp_path: Path) -> None:
    settings = DataSettings(seed=3, pixels=8, variants=(Variant(1, "fresh"),))
    claim_folder(tmp_path / "data", settings)
    assert read_settings(tmp_path / "data") == settings
    claim_folder(tmp_path / "data", settings)
    with pytest.raises(EvsError, match=r"other settings \(seed 3, not 4; .*another folder"):
        claim_folder(tmp_path / "data", DataSettings(seed=4, pixels=8))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "robot.npz").write_bytes(b"")
    with pytest.raises(EvsError, match="take another"):
        claim_folder(tmp_path / "mine", settings)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"pixels": 0}, "pixels is 0"),
        ({"ticks": 1}, "ticks is 1"),
        ({"truth_spp": 5000}, "truth_spp is 5000"),
        ({"seed": -1}, "seed is -1"),
        ({"variants": ()}, "no variant"),
        ({"variants": (Variant(0, "fixed"),)}, "0 spp"),
        ({"variants": (Variant(4, "other"),)}, "fixed or fresh"),
    ],
)
def test_settings_without_sense_are_refused(values, says: str) -> None:
    with pytest.raises(EvsError, match=says):
        DataSettings(**values)


def test_pipes_are_not_waited_for(tmp_path: Path) -> None:
    for name in (SETTINGS_FILE, "00000.npz"):
        os.mkfifo(tmp_path / name)
    readers: list[Callable[[], object]] = [
        lambda: read_settings(tmp_path),
        lambda: claim_folder(tmp_path, DataSettings()),
        lambda: read_shard(tmp_path / "00000.npz"),
    ]
    for read in readers:
        with not_waited_for(), pytest.raises(EvsError, match=r"pipe or a device|cannot read"):
            read()
