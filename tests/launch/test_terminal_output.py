"""What is shown: plain lines into a pipe, a table and a bar on a terminal, nothing with --quiet."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from evs.drivers.clock import StageTime
from evs.drivers.run.report import STAGES, Report
from evs.launch.support import terminal

REPORT = Report(
    real_time_factor=0.25,
    ticks=2000,
    sim_seconds=2.0,
    wall_seconds=8.0,
    packets=2000,
    events=3_000_000,
    traced_fraction=0.125,
    stage_ms={stage: StageTime(1.0 + k, 2.0 + k) for k, stage in enumerate(STAGES)},
    sinks=[{"type": "zmq", "packets_sent": 1999, "lost": 0, "address": "tcp://[::1]:5"}],
)


def test_the_summary_in_a_pipe_is_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.summary(REPORT, next_commands=["evs view [a].aedat4"])
    told = capsys.readouterr().out
    lines = told.splitlines()
    assert "events            3,000,000 (1.5 M events per simulated second)" in lines
    assert "real-time factor  0.25" in lines
    assert "render_ms         2.000 median, 3.000 p99" in lines
    assert "packets           2,000" in lines
    assert "zmq               packets sent 1999, address tcp://[::1]:5" in lines
    assert lines[-1] == "  evs view [a].aedat4"
    assert "\x1b" not in told


def test_drops_are_told_with_their_causes_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.summary(REPORT)
    assert "events dropped    0" in capsys.readouterr().out.splitlines()
    cameras = [
        {"events_dropped": {"roi": 7, "erc": 0, "fifo": 1000}},
        {"events_dropped": {"roi": 5}},
    ]
    terminal.summary(replace(REPORT, events_dropped=1022, cameras=cameras))
    assert "events dropped    1,022 (fifo 1,000, roi 12, a sink's queue 10)" in (
        capsys.readouterr().out.splitlines()
    )


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.summary(REPORT, quiet=True)
    with terminal.progress(10, quiet=True) as moved:
        assert moved is None
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", "")


def test_a_pipe_gets_no_bar(capsys: pytest.CaptureFixture[str]) -> None:
    with terminal.progress(10) as moved:
        assert moved is None
    assert capsys.readouterr().err == ""


def test_a_warning_is_one_line_however_long(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.warn("dark [scene] " * 30)
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert told.startswith("evs: warning: dark [scene] dark")


def test_an_empty_run_is_shown_too(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.summary(Report(ended="interrupted at 0 s"))
    assert "ended             interrupted at 0 s" in capsys.readouterr().out


PROGRAM = """
import sys
sys.path[:0] = [folder for folder in sys.argv[1].split(":")]
from evs.drivers.run.run import Progress
from evs.launch.support import terminal
sys.path.insert(0, sys.argv[2])
from test_terminal_output import REPORT
with terminal.progress(100) as moved:
    for tick in range(1, 101):
        moved(Progress(tick, 100, tick * 1e-3, tick * 50, tick * 0.05))
terminal.summary(REPORT, next_commands=["evs view run.aedat4"])
"""


def on_a_terminal(program: str, *arguments: str) -> str:
    """What a program writes when stdout and stderr are a terminal."""
    ours, its = pty.openpty()
    written: list[bytes] = []

    def read() -> None:
        while True:
            try:
                some = os.read(ours, 65536)
            except OSError:
                return
            if not some:
                return
            written.append(some)

    reader = threading.Thread(target=read)
    reader.start()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "40"}
    environment.pop("NO_COLOR", None)
    try:
        command = [sys.executable, "-c", program, *arguments]
        subprocess.run(command, stdout=its, stderr=its, env=environment, timeout=60, check=True)
    finally:
        os.close(its)
        reader.join(10)
        os.close(ours)
    return b"".join(written).decode()


@pytest.mark.integration
def test_a_terminal_gets_a_bar_and_a_table() -> None:
    shown = on_a_terminal(PROGRAM, ":".join(sys.path), str(Path(__file__).parent))
    assert "emulating" in shown
    assert "50 kev/s" in shown
    assert "0.02x real time" in shown
    assert "run complete" in shown
    for stage in STAGES:
        assert stage in shown
    assert "\x1b[" in shown
    assert "evs view run.aedat4" in shown


PLAIN_BAR = """
import sys
sys.path[:0] = [folder for folder in sys.argv[1].split(":")]
from evs.launch.support import terminal
with terminal.bar("rendering", 20) as moved:
    for frame in range(1, 21):
        moved(frame, f"frame {frame}")
"""


def test_a_plain_bar_is_drawn_on_a_terminal_and_nowhere_else(
    capsys: pytest.CaptureFixture[str],
) -> None:
    shown = on_a_terminal(PLAIN_BAR, ":".join(sys.path))
    assert "rendering" in shown
    assert "frame 20" in shown
    for quiet in (False, True):
        with terminal.bar("rendering", 3, quiet) as moved:
            moved(3, "done")
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", "")
