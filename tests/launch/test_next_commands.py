"""The commands that evs prints to be tried next: each parses, and says what was meant."""

from __future__ import annotations

import argparse
import shlex

import pytest

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
    return main._parser("emulate", emulate).parse_intermixed_args(words)


def test_a_recording_is_looked_at_by_its_quoted_name() -> None:
    args = argparse.Namespace()
    assert emulate.next_commands(args, ["a b.aedat4", "c.npz"], []) == [
        "'my tools/evs' info 'a b.aedat4'",
        "'my tools/evs' view 'a b.aedat4' -o 'a b.gif'",
    ]


def test_a_run_that_left_nothing_is_repeated_with_a_recording() -> None:
    given = "emulate humanoid --scene 'my robot.xml' --spp 2 name='left eye'"
    words = shlex.split(given)[1:]
    args = main._parser("emulate", emulate).parse_intermixed_args(words)
    (line,) = emulate.next_commands(args, [], [])
    again = parsed(line)
    assert again.record == "run.aedat4"
    assert (again.words, again.scene, again.spp) == (args.words, args.scene, args.spp)


def test_a_published_run_is_listened_to() -> None:
    args = main._parser("emulate", emulate).parse_intermixed_args(["humanoid"])
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
    found.format, found.left_out = "aedat4", {}
    lines = dict(info._lines(found))
    assert lines["torn"].endswith("'my tools/evs' info --repair 'a b.aedat4' cuts them")
