"""The commands that evs prints to be tried next: each parses, and says what was meant."""

from __future__ import annotations

import argparse
import shlex
import subprocess
from pathlib import Path

import pytest

from evs.drivers.search_path import search_path
from evs.launch import main
from evs.launch.commands import emulate, info
from evs.launch.support.reinvoke import program


@pytest.fixture(autouse=True)
def called_from_a_folder_with_spaces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["my tools/evs"])
    monkeypatch.setenv("PATH", "")


def parsed(line: str) -> argparse.Namespace:
    """The arguments of a printed command, read as a shell would."""
    begin = f"{program()} emulate "
    assert line.startswith(begin), line
    words = shlex.split(line.removeprefix(begin), comments=True)
    return main.parser_of("emulate", emulate).parse_intermixed_args(words)


def test_a_recording_is_looked_at_by_its_quoted_name() -> None:
    args = argparse.Namespace()
    assert emulate.next_commands(args, ["a b.aedat4", "c.npz"], []) == [
        "'my tools/evs' info 'a b.aedat4'",
        "'my tools/evs' view 'a b.aedat4' -o 'a b.gif'",
    ]


def test_a_run_that_left_nothing_is_repeated_with_a_recording() -> None:
    given = "emulate humanoid --scene 'my robot.xml' --spp 2 --size 64x48 name='left eye'"
    words = shlex.split(given)[1:]
    args = main.parser_of("emulate", emulate).parse_intermixed_args(words)
    (line,) = emulate.next_commands(args, [], [])
    again = parsed(line)
    assert again.record == "run.aedat4"
    assert (again.words, again.scene, again.spp) == (args.words, args.scene, args.spp)
    assert again.size == "64x48"


def test_a_published_run_is_listened_to() -> None:
    args = main.parser_of("emulate", emulate).parse_intermixed_args(["humanoid"])
    first, second = emulate.next_commands(args, [], ["tcp://127.0.0.1:5560"])
    listen, _, run = first.partition(" & ")
    assert listen == f"{program()} echo tcp://127.0.0.1:5560 --hz"
    assert parsed(run).words == ["humanoid"]
    assert parsed(second).record == "run.aedat4"
    # nobody knows the port of the next run
    assert len(emulate.next_commands(args, [], ["tcp://127.0.0.1:0"])) == 1


def test_the_repair_of_a_torn_file_is_quoted() -> None:
    from evs.drivers.files import Summary
    from evs.msgs import StreamInfo

    stream = StreamInfo(width=8, height=6)
    found = argparse.Namespace(
        **dict.fromkeys(Summary.__dataclass_fields__, 0), rate_hz=None, duration_s=0.0
    )
    found.stream, found.path, found.torn_at, found.torn_bytes = stream, "a b.aedat4", 7, 3
    found.format, found.left_out, found.streams = "aedat4", {}, ()
    lines = dict(info._lines(found))
    assert lines["torn"].endswith("'my tools/evs' info --repair 'a b.aedat4' cuts them")


ROBOT = """<mujoco><option timestep=".001" gravity="0 0 0"/><worldbody><light pos="0 0 3"/>
<camera name="eye" pos="0 -1 .5" xyaxes="1 0 0 0 .4 1"/><geom type="plane" size="2 2 .1"/>
<body pos="0 0 .3"><joint name="j" axis="0 1 0" damping=".01"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".04"/></body></worldbody>
<actuator><motor joint="j" ctrlrange="-9 9"/></actuator></mujoco>"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("sys.argv", ["python"])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.xml").write_text(ROBOT)
    return tmp_path


def printed(out: str) -> list[str]:
    return [line.strip() for line in out.partition("next:\n")[2].splitlines()]


def shell(line: str) -> str:
    path = {"PATH": "/usr/bin:/bin", "PYTHONPATH": search_path()}
    done = subprocess.run(
        ["bash", "-c", line], env=path, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, ""), line
    return done.stdout


@pytest.mark.slow
def test_every_next_line_runs_as_printed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From a robot that stands still to a film of one that moves, by the printed lines alone."""
    words = ["robot.xml", "sensor.width=32", "sensor.height=24", "--duration", "0.2"]
    assert main.main(["emulate", *words]) == 0
    (line,) = printed(capsys.readouterr().out)
    assert line.endswith("--record run.aedat4  # nothing moved: random controls move the robot")
    assert parsed_words(line)[-1] == "scene.control=random"
    lines = printed(shell(line))
    assert [shlex.split(one)[3] for one in lines] == ["info", "view"]
    for one in lines:
        shell(one)
    assert (here / "run.gif").stat().st_size > 1000
    # once more, where the files are there
    assert main.main(["emulate", *words]) == 0
    (again,) = printed(capsys.readouterr().out)
    assert "--record run-2.aedat4" in again
    assert main.main(["emulate", *words, "--record", "run.aedat4", "--force"]) == 0
    (still,) = printed(capsys.readouterr().out)
    assert "scene.control=random" in still
    assert shell(still)


def parsed_words(line: str) -> list[str]:
    words = shlex.split(line, comments=True)[4:]
    return list(main.parser_of("emulate", emulate).parse_intermixed_args(words).words)
