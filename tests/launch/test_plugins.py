"""Commands of other distributions: listed, completed and run as those of evs; evs-lab missing."""

from __future__ import annotations

import importlib.metadata
import os
from pathlib import Path

import pytest

from evs.launch import main
from evs.launch.commands import doctor
from reference.shell import offered

Capture = pytest.CaptureFixture[str]

TABLE = {"Recordings": {"greet": "greets"}, "Of others": {"part": "parts"}}
MODULE = """
def configure(parser):
    parser.add_argument("name")

def run(args):
    print("hello", args.name)
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of packages with a distribution that adds two commands."""
    package = tmp_path / "site/others"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(f"COMMANDS = {TABLE!r}")
    (package / "greet.py").write_text(MODULE)
    metadata = tmp_path / "site/others-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text("[evs.commands]\nothers = others:COMMANDS\n")
    monkeypatch.syspath_prepend(package.parent)
    return package.parent


def test_its_commands_are_commands(installed: Path, capsys: Capture) -> None:
    assert main.main(["--help"]) == 0
    text = capsys.readouterr().out
    recordings = text.partition("\nRecordings:\n")[2].partition("\n\n")[0]
    assert recordings.splitlines()[-1].split() == ["greet", "greets"]
    assert "\nOf others:\n  part          parts\n" in text
    assert main.main(["greet", "you"]) == 0
    assert capsys.readouterr().out == "hello you\n"
    with pytest.raises(SystemExit):
        main.main(["greet", "--help"])
    assert "usage: evs greet" in capsys.readouterr().out
    assert main.main(["gret"]) == 2
    assert "greet" in capsys.readouterr().err


def test_its_commands_are_completed(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [str(installed), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in paths if path))
    assert offered("evs gr", tmp_path) == ["greet "]


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The camera without other distributions."""
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda **_: ())


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("words", "what"),
    [
        *((words, f"evs {words[0]}") for words in (["evaluate"], ["sweep", "a.xml"], ["tune"])),
        (["train", "fit", "--help"], "evs train"),
        (["doctor", "--markdown", "a.md"], "the table of stress cases"),
    ],
)
def test_without_evs_lab_a_line_says_what_installs_it(
    words: list[str], what: str, capsys: Capture
) -> None:
    assert main.main(words) == 2
    assert capsys.readouterr().err == (
        f"evs: {what} is part of evs-lab, which is not installed: pip install ./lab in a checkout "
        "of evs\n"
    )


@pytest.mark.usefixtures("alone")
def test_without_evs_lab_the_camera_is_listed_and_examined(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main.commands() == main.COMMANDS
    monkeypatch.setattr(doctor, "examine", lambda: iter(()))
    assert main.main(["doctor"]) == 0
    assert capsys.readouterr().out == f"{doctor.FIT}\n"
