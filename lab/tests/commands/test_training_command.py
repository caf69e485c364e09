"""`evs train fit`: what it refuses, and that it writes what it says."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from evs.launch.main import main
from evs.msgs import EvsError
from evs_lab.commands import train
from evs_lab.training.recipes import RECIPES
from reference.shards import synthetic_data
from reference.shell import offered


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return synthetic_data(tmp_path_factory.mktemp("data") / "d", 2, 8, 60)


def test_the_recipes_named_in_the_help_are_those_there_are() -> None:
    assert set(train.RECIPES) == set(RECIPES)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--recipe", "evsnet_c9"], "no recipe 'evsnet_c9'"),
        (["--steps", "0"], "--steps is 0"),
        (["--batch", "100"], "multiple of 32"),
        (["--spp", "0"], "--spp is 0"),
        (["--spp", "3"], "there is no light of 3 spp"),
        (["--minutes", "-1"], "minutes is -1"),
        (["--look-ahead", "22"], "look-ahead is 22"),
        (["--events-per-tick", "few"], "no number of events per tick 'few'; there is: "),
        (["--seeds", "0"], "--seeds"),
        (["--seeds", "2", "--checkpoint", "a.npz"], "--checkpoint belongs to one training"),
        (["--name", "a/b"], "--name"),
        ([], "there is no light of 1 spp"),
    ],
)
def test_what_the_user_can_mend_is_one_line(
    words: list[str],
    says: str,
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code = main(["train", "fit", str(folder), "-o", str(tmp_path / "out"), *words])
    told = capsys.readouterr().err
    assert code == 2
    assert told.count("\n") == 1
    assert says in told


def test_a_folder_without_data_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "fit", str(tmp_path), "-o", str(tmp_path)]) == 2
    assert "evs train data" in capsys.readouterr().err


def test_help_and_the_list_of_commands_need_no_jax() -> None:
    program = (
        "import sys\n"
        "from evs.launch.main import main\n"
        "main(['--help'])\n"
        "try:\n    main(['train', 'fit', '--help'])\nexcept SystemExit:\n    pass\n"
        "assert not {'jax', 'optax', 'onnx', 'onnxruntime'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)


def test_its_commands_are_completed(tmp_path: Path) -> None:
    assert offered("evs train f", tmp_path) == ["fit "]


def test_a_missing_library_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    train.need_jax()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        EvsError, match=r"training needs jax and optax: pip install './lab\[train\]'"
    ):
        train.need_jax()
