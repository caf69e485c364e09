"""`evs render` as a program that is stopped: what was rendered until then can be read."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.search_path import search_path

pytestmark = pytest.mark.integration

SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1"/>
    <geom type="plane" size="2 2 .1"/>
    <body pos="0 0 1"><freejoint/><geom size=".3"/></body>
  </worldbody>
</mujoco>"""


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """An hour at every tick: it does not end by itself."""
    (tmp_path / "ball.xml").write_text(SCENE)
    monkeypatch.setenv("PYTHONPATH", search_path())
    monkeypatch.chdir(tmp_path)
    program = [sys.executable, "-m", "evs.launch.main", "render", "--scene", "ball.xml"]
    return [*program, "--size", "8x6", "--fps", "tick", "--duration", "20", "-o", "a.npz"]


def frames_in(path: Path) -> int:
    """How many whole frames are in it now; 0: it cannot be read yet, or is still empty."""
    try:
        # what numpy opens itself it does not close at once where it fails
        with path.open("rb") as raw, np.load(raw) as file:
            return len(file["t_us"])
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return 0


def started(command: list[str]) -> subprocess.Popen[str]:
    """The program after its fifth frame."""
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    limit = time.monotonic() + 60
    while frames_in(Path("a.npz")) < 5:
        if running.poll() is not None or time.monotonic() > limit:
            running.kill()
            pytest.fail(str(running.communicate()))
        time.sleep(0.01)
    return running


def expect_frames(least: int) -> int:
    with np.load("a.npz") as file:
        stacks = {name: file[name] for name in file.files}
    frames = len(stacks["t_us"])
    assert frames >= least
    assert all(len(stack) == frames for name, stack in stacks.items() if name != "info")
    np.testing.assert_array_equal(stacks["t_us"], np.arange(frames) * 1000)
    assert (stacks["luminance"].max((1, 2)) > 0).all()
    assert (stacks["geom_id"] >= 0).any((1, 2)).all()
    return frames


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")],
)
def test_a_signal_ends_it_between_two_frames(
    command: list[str], number: signal.Signals, code: int, word: str
) -> None:
    running = started(command)
    running.send_signal(number)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, err) == (code, "")
    frames = expect_frames(5)
    assert f"{frames} frames of 20001 ({word})" in out
    # and the room for the others was given back
    assert Path("a.npz").stat().st_size < 3000 * (frames + 10)


def test_a_disk_without_room_is_one_line_before_the_first_frame(command: list[str]) -> None:
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000)),
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert "cannot write a.npz" in done.stderr
    assert "MB are needed" in done.stderr
    assert not Path("a.npz").exists()
