"""`evs` itself: help that teaches, one line for every mistake, tracebacks for our own bugs."""

from __future__ import annotations

import argparse
import errno
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from evs.drivers.run.config import PipelineConfig
from evs.drivers.run.config_reference import describe
from evs.drivers.search_path import search_path
from evs.launch import main
from evs.launch.commands import emulate
from evs.msgs import EvsError

Capture = pytest.CaptureFixture[str]


def add_command(
    monkeypatch: pytest.MonkeyPatch, run: Callable[[argparse.Namespace], int | None]
) -> None:
    """A command `fake` with one option and one positional."""

    def configure(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("words", nargs="*")
        parser.add_argument("--number", type=int)

    module = SimpleNamespace(configure=configure, run=run)
    monkeypatch.setitem(sys.modules, "evs.launch.commands.fake", module)
    monkeypatch.setitem(main.COMMANDS, "fake", "does nothing")


@pytest.mark.parametrize("words", [[], ["-h"], ["--help"], ["help"]])
def test_help_teaches_what_evs_is_its_commands_and_three_examples(
    words: list[str], capsys: Capture
) -> None:
    assert main.main(words) == 0
    told = capsys.readouterr().out
    assert "event camera for MuJoCo" in told
    for name in main.COMMANDS:
        line = re.search(rf"^  {name} +(\S.*)$", told, re.MULTILINE)
        assert line, name
    # each example is one line to copy, and names a command that exists
    examples = re.findall(r"^  evs (\w+) .*$", told, re.MULTILINE)
    assert len(examples) >= 3
    assert set(examples) <= set(main.COMMANDS)


def test_every_command_has_a_module_and_one_heading() -> None:
    listed = [name for group in main.GROUPS.values() for name in group]
    modules = {path.stem for path in Path(main.__file__).parent.glob("commands/[a-z]*.py")}
    assert len(listed) == len(set(listed))
    assert set(listed) == modules


def test_help_of_every_command_works(capsys: Capture) -> None:
    for name in main.COMMANDS:
        with pytest.raises(SystemExit) as ended:
            main.main([name, "--help"])
        assert ended.value.code == 0
        assert capsys.readouterr().out.startswith(f"usage: evs {name}")


def test_emulates_help_lists_every_key_with_its_default_and_its_meaning(capsys: Capture) -> None:
    with pytest.raises(SystemExit):
        main.main(["emulate", "--help"])
    told = capsys.readouterr().out
    flat = " ".join(told.split())
    for table in describe(PipelineConfig):
        for key in table.keys:
            assert f"  {key.name}={key.default}\n" in told
            assert key.doc in flat
    for option, (key_name, _, _) in emulate.OPTIONS.items():
        assert f"--{option} " in told
        assert f"short for {key_name}=" in flat


def test_the_version_is_told(capsys: Capture) -> None:
    assert main.main(["--version"]) == 0
    assert re.fullmatch(r"evs \S.*\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["emulat"], "evs: no command 'emulat'; there is: emulate, "),
        (["--vresion"], "evs: no option '--vresion'"),
        (["fake", "--nubmer", "3"], "evs: unrecognized arguments: --nubmer"),
        (["fake", "--numb", "3"], "evs: unrecognized arguments: --numb"),
        (["fake", "--number", "x"], "evs: argument --number: invalid int value: 'x'"),
        (["fake", "--number"], "evs: argument --number: expected one argument"),
        (["fake", "--number", "9" * 20], "evs: argument --number: 99999999999999999999 is not"),
        (["fake", "--number", f"-{2**31}"], "evs: argument --number: -2147483648 is not within"),
    ],
)
def test_a_wrong_command_line_is_one_line_with_the_way_to_help(
    words: list[str], said: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_command(monkeypatch, lambda args: 0)
    assert main.main(words) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith(said)
    assert told.err.count("\n") == 1
    assert "--help)" in told.err


def test_options_and_words_may_be_mixed(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[argparse.Namespace] = []
    add_command(monkeypatch, lambda args: seen.append(args))
    assert main.main(["fake", "a", "--number", "3", "b=c", "d=-4"]) == 0
    assert seen[0].words == ["a", "b=c", "d=-4"]
    assert seen[0].number == 3


def test_the_exit_code_is_the_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    add_command(monkeypatch, lambda args: 7)
    assert main.main(["fake"]) == 7


def test_an_error_of_many_lines_becomes_one(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    def run(args: argparse.Namespace) -> int:
        raise EvsError("XML Error:\n  line 3\n")

    add_command(monkeypatch, run)
    assert main.main(["fake"]) == 2
    assert capsys.readouterr().err == "evs: XML Error: line 3\n"


def test_ctrl_c_outside_of_a_run_is_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(args: argparse.Namespace) -> int:
        raise KeyboardInterrupt

    add_command(monkeypatch, run)
    assert main.main(["fake"]) == 130


def test_our_own_bugs_keep_their_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(args: argparse.Namespace) -> int:
        raise ZeroDivisionError

    add_command(monkeypatch, run)
    with pytest.raises(ZeroDivisionError):
        main.main(["fake"])


@pytest.mark.integration
def test_a_reader_that_leaves_is_no_error() -> None:
    line = (
        f"'{sys.executable}' -m evs.launch.main emulate --help | head -1; exit ${{PIPESTATUS[0]}}"
    )
    ended = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60)
    assert ended.stderr == ""
    assert ended.returncode in (0, 141)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError(), "evs: out of memory; take a smaller sensor"),
        (
            ImportError("x.so: failed to\n map"),
            "evs: cannot load what it needs (x.so: failed to map)",
        ),
    ],
)
def test_no_memory_is_one_line(
    error: Exception,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fails(words: list[str]) -> int:
        raise error

    monkeypatch.setattr(main, "_dispatch", fails)
    assert main.main(["emulate"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(said)


@pytest.mark.parametrize("words", ["--version", "sensors"])
def test_output_that_finds_no_room_is_one_line(words: str) -> None:
    line = f"'{sys.executable}' -m evs.launch.main {words} > /dev/full"
    ended = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60)
    assert ended.stderr == "evs: cannot write its output: No space left on device; make room\n"
    assert ended.returncode == 2


LONG = "d" * 300
"""no file system has a name so long: stat fails as it does in a folder of somebody else's"""


@pytest.mark.parametrize(
    "words",
    [
        f"plan {LONG}.xml",
        f"emulate {LONG}.toml",
        f"emulate humanoid sensor.preset=/{LONG}.toml",
        f"emulate humanoid --record {LONG}.aedat4",
        f"emulate humanoid report={LONG}.json",
        f"emulate humanoid scene.control=file scene.control_file={LONG}.npy",
        f"convert {LONG}.aedat4 a.raw",
        f"launch {LONG}.toml",
        f"sensors {LONG}.toml",
        f"record tcp://127.0.0.1:9 {LONG}.aedat4",
        f"dataset {LONG} --scenes kitchen",
    ],
)
def test_a_path_out_of_reach_is_one_line(words: str, capsys: Capture) -> None:
    assert main.main(words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("evs: ")
    assert LONG in line
    assert "File name too long" in line


@pytest.mark.parametrize(
    ("number", "file", "said"),
    [
        (errno.ENOSPC, None, "cannot write its output: No space left on device; make room"),
        (errno.ENOSPC, "a.npz", "cannot write 'a.npz': No space left on device; make room"),
        (errno.EFBIG, None, "the system refuses something that evs needs: File too large"),
        (errno.EMFILE, "a", "cannot reach 'a': Too many open files; give another path, or the"),
        (errno.EIO, None, "the system refuses something that evs needs: Input/output error"),
    ],
)
def test_whatever_the_system_refuses_is_one_line(
    number: int, file: str | None, said: str, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    def run(args: argparse.Namespace) -> int:
        raise OSError(number, os.strerror(number), file)

    monkeypatch.setattr(main, "_discard_output", lambda: None)
    add_command(monkeypatch, run)
    assert main.main(["fake"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"evs: {said}")


def test_a_deleted_working_folder_is_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    line = f"cd {folder}; rmdir {folder}; '{sys.executable}' -m evs doctor --quick"
    environment = {**os.environ, "PYTHONPATH": search_path()}
    ended = subprocess.run(
        ["bash", "-c", line], env=environment, capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 2
    assert "evs: the folder that this shell is in cannot be reached" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_what_a_terminal_cannot_show_becomes_a_question_mark(tmp_path: Path) -> None:
    code = (
        "import sys, types; from evs.launch import main; "
        "f = types.SimpleNamespace(configure=lambda p: None, run=lambda a: print('1 \u03c3')); "
        "sys.modules['evs.launch.commands.info'] = f; sys.exit(main.main(['info']))"
    )
    environment = {
        **os.environ,
        "PYTHONIOENCODING": "ascii",
        "PYTHONPATH": search_path(),
    }
    ended = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "1 ?\n", "")


TEXT_KEYS = [
    *("report", "record", "publish", "scene.file", "scene.camera", "scene.keyframe"),
    *("scene.control", "scene.control_file", "camera.body", "camera.trajectory", "sensor.preset"),
    *("sensor.readout.mask_file", "model.network", "sink.0.file", "sink.0.allow", "lockstep.key"),
]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        *((f"{key}=a\0b", "null character") for key in TEXT_KEYS),
        *((f"{key}=a\udcffb", "is not UTF-8 text") for key in TEXT_KEYS),
        ("scene.camera=a\udcffb", "at scene.camera: 'a\\udcffb' is not UTF-8 text"),
        ("\udcff.xml", "at scene.file: '\\udcff.xml' is not UTF-8 text"),
    ],
)
def test_text_that_no_file_or_model_can_hold_is_one_line(
    words: str, said: str, capsys: Capture
) -> None:
    assert main.main(["emulate", words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("evs: at ")
    assert said in line


def test_the_same_in_a_pipeline_file(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "nul.toml"
    for text, key in (
        ('report = "x\\u0000"', "report"),
        ('[[sink]]\ntype = "aedat4"\nfile = "x\\u0000"', "sink.0.file"),
        ('[camera]\ntrajectory = "x\\u0000"', "camera.trajectory"),
    ):
        file.write_text(text)
        assert main.main(["emulate", str(file)]) == 2
        assert capsys.readouterr().err.startswith(f"evs: {file}: at {key}: ")


def test_python_m_evs_is_evs() -> None:
    ended = subprocess.run(
        [sys.executable, "-W", "error", "-m", "evs", "--version"], capture_output=True, timeout=60
    )
    assert ended.stdout.startswith(b"evs ")


# Python itself has no handler before its site is loaded, and what comes after is tried elsewhere
CTRL_C = """
import importlib.abc, os, signal, sys
class Interrupting(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == sys.argv[1]:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
from evs.__main__ import main
sys.exit(main(["plan", "evs:config/scenes/pendulum.xml"]))
"""


@pytest.mark.parametrize(
    ("module", "code"),
    [
        ("evs.launch.main", -signal.SIGINT),
        ("argparse", -signal.SIGINT),
        ("evs.emulator.base.memory_limits", -signal.SIGINT),
        ("evs.launch.commands.plan", 130),
        ("mujoco", 130),
    ],
)
def test_ctrl_c_while_modules_load_leaves_no_traceback(module: str, code: int) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", CTRL_C, module], capture_output=True, text=True, timeout=60
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "", "")
