"""A machine for which onnxruntime has no wheel: all works but what asks for it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from evs.launch.main import main

SCENE = str(Path(__file__).parents[2] / "config/scenes/pendulum.xml")
NETWORK = ["--model", "evsnet", "sensor.width=32", "sensor.height=24"]
RUN = ["emulate", SCENE, "--duration", "0.01", "--quiet", *NETWORK]


@pytest.fixture(autouse=True)
def without(monkeypatch: pytest.MonkeyPatch) -> None:
    """`import onnxruntime` fails."""
    monkeypatch.setitem(sys.modules, "onnxruntime", None)


@pytest.mark.parametrize("words", [RUN, ["plan", SCENE, *NETWORK], [*RUN, "--record", "a.aedat4"]])
def test_the_native_runtime_needs_none(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 0


@pytest.mark.parametrize(
    "words",
    [
        [*RUN, "model.runtime=onnxruntime"],
        ["plan", SCENE, *NETWORK, "model.runtime=onnxruntime"],
    ],
)
def test_asked_for_it_is_one_line_with_the_fix(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if "pip install onnxruntime" in line] == said[-1:]
    assert "model.runtime=native" in said[-1]
