"""The runner and signals: nothing half is left, nobody stays behind, who insists is obeyed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.search_path import search_path
from evs.tools.jobs import run_jobs
from evs.tools.jobs.target_folder import PREFIX
from speed import jobs

PROGRAM = """
import sys
import threading
import time
from pathlib import Path
from speed.jobs import Noise
from evs.drivers.run.stop_signals import stop_signals
from evs.tools.jobs import run_jobs

def hear(stopped):
    while not stopped:
        time.sleep(0.01)
    Path(sys.argv[0]).with_name("heard").touch()

if __name__ == "__main__":
    with stop_signals() as stopped:
        threading.Thread(target=hear, args=(stopped,), daemon=True).start()
        print("ready", flush=True)
        ran = run_jobs(
            [Noise(number, seconds=(number > 0) * float(sys.argv[2])) for number in range(40)],
            Path(sys.argv[1]),
            workers=2,
            on_done=lambda job, _: print(job.name, flush=True),
            stopped=lambda: bool(stopped),
        )
    print(stopped, ran, flush=True)
"""


def names(folder: Path) -> list[str]:
    """What lies in a folder."""
    return sorted(path.name for path in folder.iterdir())


def started(tmp_path: Path, seconds: float) -> subprocess.Popen[str]:
    """The program in a process group of its own, with its first job home."""
    script = tmp_path / "program.py"
    script.write_text(textwrap.dedent(PROGRAM))
    program = subprocess.Popen(
        [sys.executable, script, str(tmp_path / "out"), str(seconds)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        env=dict(os.environ, PYTHONPATH=search_path()),
    )
    assert program.stdout is not None
    assert program.stdout.readline() == "ready\n"
    assert program.stdout.readline().startswith("noise/")
    return program


def assert_gone(session: int) -> None:
    """Nobody is left of a session, or soon: multiprocessing's own helper ends after its parent."""
    began_s = monotonic_s()
    while jobs.processes_of(session) and monotonic_s() - began_s < 10.0:
        sleep_s(0.02)
    assert jobs.processes_of(session) == []


@pytest.mark.slow
@pytest.mark.parametrize("how", ["interrupted", "terminated", "killed"])
def test_signals_leave_nothing_half_and_nobody_behind(tmp_path: Path, how: str) -> None:
    program = started(tmp_path, 0.3)
    if how == "interrupted":
        # as a terminal does: to the whole group
        os.killpg(program.pid, signal.SIGINT)
    elif how == "terminated":
        program.terminate()
    else:
        program.kill()
    said, _ = program.communicate(timeout=60)
    assert_gone(program.pid)
    whole = list((tmp_path / "out/noise").iterdir())
    assert 1 <= len(whole) < 40
    assert all(names(path) == ["a.bin", "empty", "in"] for path in whole)
    left = list((tmp_path / "out").glob(f"{PREFIX}*"))
    if how == "killed":
        assert program.returncode == -signal.SIGKILL
        assert len(left) == 1
    else:
        assert program.returncode == 0
        assert f"['{how}'] JobSummary(made={len(whole)}, kept=0, left={40 - len(whole)}" in said
        assert left == []
    assert run_jobs([jobs.Noise(number) for number in range(40)], tmp_path / "out").made > 0
    assert list((tmp_path / "out").glob(f"{PREFIX}*")) == []


@pytest.mark.integration
def test_who_insists_is_obeyed_at_once(tmp_path: Path) -> None:
    program = started(tmp_path, 60.0)
    program.send_signal(signal.SIGINT)
    # two signals that a busy machine brings together are one
    began_s = monotonic_s()
    while not (tmp_path / "heard").exists():
        assert monotonic_s() - began_s < 30.0
        sleep_s(0.02)
    # later than what counts as the same wish said twice
    sleep_s(0.5)
    assert program.poll() is None
    program.send_signal(signal.SIGINT)
    program.communicate(timeout=20)
    assert program.returncode != 0
    assert_gone(program.pid)
    assert names(tmp_path / "out") == ["noise"]
    assert names(tmp_path / "out/noise") == ["000"]
