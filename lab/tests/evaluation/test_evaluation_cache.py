"""Traced light on disk: found again byte for byte, made anew where anything is different."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from evs.msgs import EvsError
from evs_lab.evaluation.digest import digest
from evs_lab.evaluation.light_cache import DamagedCacheWarning, LightCache, user_cache
from evs_lab.evaluation.scenes import SceneSetup

LIGHT = np.arange(12, dtype=np.float32).reshape(3, 4)


def test_found_again_and_made_once(tmp_path: Path) -> None:
    made = []

    def make() -> np.ndarray:
        made.append(1)
        return LIGHT

    for cache in (LightCache(tmp_path / "a" / "b"), LightCache(tmp_path / "a" / "b")):
        assert cache.get("key", (3, 4), make).tobytes() == LIGHT.tobytes()
    assert len(made) == 1
    assert (cache.hits, cache.misses) == (1, 0)
    assert [path.name for path in cache.folder.iterdir()] == ["key.npz"]


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "text", "shape", "other"])
def test_damage_is_told_and_made_anew(damage: str, tmp_path: Path) -> None:
    cache = LightCache(tmp_path)
    cache.get("key", (3, 4), lambda: LIGHT)
    path = tmp_path / "key.npz"
    whole = path.read_bytes()
    place = whole.index(LIGHT.tobytes()) + 9
    if damage == "shape":
        np.savez(path, light=LIGHT[:2])
    elif damage == "other":
        np.savez(path, dark=LIGHT)
    else:
        path.write_bytes(
            {
                "cut": whole[: len(whole) // 2],
                "flip": whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :],
                "empty": b"",
                "text": b"no archive",
            }[damage]
        )
    with pytest.warns(DamagedCacheWarning, match=r"key\.npz is damaged and is made anew"):
        found = cache.get("key", (3, 4), lambda: LIGHT)
    assert found.tobytes() == LIGHT.tobytes()
    assert path.read_bytes() == whole
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cache.get("key", (3, 4), lambda: np.zeros((3, 4), np.float32))


def test_interrupted_it_leaves_nothing(tmp_path: Path) -> None:
    cache = LightCache(tmp_path)

    def stop() -> np.ndarray:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cache.get("key", (3, 4), stop)
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_its_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(EvsError, match="no cache folder"):
        LightCache(tmp_path / "file")


def test_a_folder_that_went_away(tmp_path: Path) -> None:
    cache = LightCache(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(EvsError, match="cannot write to the cache"):
        cache.get("key", (3, 4), lambda: LIGHT)


def test_where_a_users_cache_lies(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache() == tmp_path / "evs" / "evaluation"
    for told in ("", "relative/path"):
        monkeypatch.setenv("XDG_CACHE_HOME", told)
        monkeypatch.setenv("HOME", str(tmp_path))
        assert user_cache() == tmp_path / ".cache" / "evs" / "evaluation"


def test_a_renamed_class_keeps_its_digest() -> None:
    @dataclass(frozen=True)
    class Stage:
        name: str
        size: int

    @dataclass(frozen=True)
    class Renamed:
        DIGEST_NAME: ClassVar[str] = "Stage"
        name: str
        size: int

    assert digest(Renamed("a", 1)) == digest(Stage("a", 1))
    assert SceneSetup.DIGEST_NAME == "Stage"
