"""Every shell line of the pages parses."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import re
import shlex
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from evs.drivers.run import config as pipeline
from evs.drivers.run.sensor_ranges import read_ranges, split_ranges
from evs.emulator.sensor.randomisation import SensorRanges
from evs.emulator.simulation.scene_ranges import SceneRanges
from evs.launch import main
from evs.launch.support.options import parse_pipeline
from evs.tools.dataset.scenes import of_file

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "lab/docs").rglob("*.md")]
)
PAGES = [page for page in PAGES if "measured" not in page.parts]

ROBOT = """
<mujoco><worldbody>
  <light name="lamp"/><geom name="floor" type="plane" size="1 1 1"/><camera name="left"/>
  <body name="arm"><joint name="hinge"/><geom name="rod" size="1"/></body>
</worldbody></mujoco>
"""
"""what the ranges of the pages name"""

# first word of a line -> why it is neither run nor parsed here
ELSEWHERE = {
    "pip": "installs packages",
    "pipx": "installs packages",
    "uvx": "installs packages",
    "ray": "starts a cluster of the reader's own",
    "ros2": "needs ROS 2",
    "rviz2": "needs ROS 2",
    "colcon": "needs ROS 2",
    "source": "sets variables of ROS 2",
    "export": "sets a variable of ROS 2",
    "perf": "a profiler of the system",
    ".venv/bin/cmake": "builds the core anew",
}

ENDS = (">", "|", "&&", ";")


def lines_of(page: Path) -> Iterator[str]:
    """The shell lines of a page: of its blocks, and of the README's indented ones."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    if page.name == "README.md":
        blocks += re.findall(r"^    (?:evs|make|pip) .*\n", text, re.MULTILINE)
    for block in blocks:
        for line in block.replace("\\\n", " ").splitlines():
            if line.strip():
                yield line.strip()
    # captions: the command that made a picture or a table
    flat = " ".join(re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE).split())
    yield from re.findall(r"\*`(evs [^`]*)`", flat)


def words_of(line: str) -> list[str]:
    """A line as the shell splits it, without comment, redirection and what stands before evs."""
    words = shlex.split(line, comments=True)
    for end in ENDS:
        if end in words:
            words = words[: words.index(end)]
    if words[:1] == ["taskset"]:
        words = words[3:]
    return words


@cache
def command_of(name: str) -> tuple[ModuleType, argparse.ArgumentParser]:
    """The module of a command and its parser."""
    module = main.module_of(name)
    return module, main.parser_of(name, module)


def parse(words: list[str], folder: Path) -> None:
    """Parse `evs` and its words by the command's own parser, and its keys by the configuration."""
    assert words[0] == "evs"
    if len(words) == 1 or words[1].startswith("-"):
        return
    if words[1] == "COMMAND":
        return
    module, parser = command_of(words[1])
    mixed = not getattr(module, "SUBCOMMANDS", False)
    parsed = (parser.parse_intermixed_args if mixed else parser.parse_args)(words[2:])
    known = getattr(module, "OPTIONS", None)
    if known is not None and isinstance(getattr(parsed, "words", None), list):
        file, overrides = parse_pipeline(parsed, known)
        if file is not None and file.endswith(".toml"):
            (folder / file).touch()
        if words[1] in ("emulate", "render", "plan"):
            # a preset wants a scene
            pipeline.load(file, [("scene.file", "robot.xml"), *overrides])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the lines are given: the files that they name relative to the checkout are there."""
    for name in ("config", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_line_of_a_page_parses(page: Path, folder: Path) -> None:
    for words in filter(None, map(words_of, lines_of(page))):
        if words[0] == "evs":
            parse(words, folder)
        elif words[0] == "make":
            assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
        elif words[0] == ".venv/bin/pytest":
            for word in words[1:]:
                if word.startswith(("tests/", "lab/tests/")):
                    assert list(ROOT.glob(word.partition("::")[0])), word
        elif words[0] == "python":
            assert importlib.util.find_spec(words[2])
        else:
            assert words[0] in ELSEWHERE


def test_the_toml_of_the_pages_loads(folder: Path) -> None:
    blocks = re.compile(r"^(?:\[toml\]|```toml)\n(.*?)^(?:\[end\]|```)", re.DOTALL | re.MULTILINE)
    texts = [text for page in PAGES for text in blocks.findall(page.read_text())]
    ranges = [text for text in texts if text.startswith("# ranges.toml")]
    texts = [text for text in texts if text not in ranges]
    # what lies beside a scene of a data set
    assert len(texts) == 1
    for text in texts:
        assert tomllib.loads(text)
        (folder / "robot.xml").write_text("<mujoco/>")
        (folder / "robot.toml").write_text(text)
        scene = of_file(str(folder / "robot.xml"), "robot")
        assert (scene.frames.fps, len(scene.motion)) == (60.0, 1)
    counts = []
    (folder / "robot.xml").write_text(ROBOT)
    for text in ranges:
        (folder / "ranges.toml").write_text(text)
        sensor, scene = split_ranges(read_ranges(folder / "ranges.toml"))
        values = SceneRanges(scene, folder / "robot.xml").draw(1).values
        counts.append((len(SensorRanges(sensor).draw(1).values), len(values)))
    # light, two colours, friction, mass, place and turn of the camera, start
    assert sorted(counts) == [(1, 16), (8, 0)]


def test_there_are_lines() -> None:
    assert len({line for page in PAGES for line in lines_of(page)}) > 120


@pytest.mark.parametrize("line", ["evs emulate --duraton 2", "evs emulate sensor.nonsense=1"])
def test_a_line_that_is_wrong_is_found(line: str, folder: Path) -> None:
    with pytest.raises(Exception, match=r"duraton|nonsense"):
        parse(words_of(line), folder)
