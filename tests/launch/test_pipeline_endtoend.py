"""`evs emulate` as a program: two recordings of a run, same bytes, early ends that lose nothing."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.files import read
from evs.drivers.search_path import search_path

pytestmark = pytest.mark.integration

SCENE = """
<mujoco model="ball">
  <option timestep="0.001"/>
  <worldbody>
    <light pos="0 -1 3" dir="0 0.3 -1"/>
    <camera name="eye" pos="0 -2 0.6" xyaxes="1 0 0 0 0.2 1"/>
    <geom type="plane" size="2 2 .1" rgba=".8 .8 .8 1"/>
    <body pos="0 0 1"><freejoint/><geom size=".2" rgba=".9 .2 .1 1"/></body>
    <body pos=".4 0 .5">
      <joint name="spin" axis="0 1 0"/><geom type="box" size=".3 .05 .05" rgba=".1 .2 .9 1"/>
    </body>
  </worldbody>
  <actuator><motor name="turn" joint="spin" gear="8"/></actuator>
  <keyframe><key name="fast" qpos="0 0 1 1 0 0 0 0" qvel="4 0 2 0 0 0 40"/></keyframe>
</mujoco>
"""

UNSTABLE = SCENE.replace('<joint name="spin"', '<joint name="spin" stiffness="-9e4"')

MOVING = ("scene.control=random", "scene.keyframe=fast")

SIZE = ("sensor.width=48", "sensor.height=36")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "ball.xml").write_text(SCENE)
    (tmp_path / "unstable.xml").write_text(UNSTABLE)
    return tmp_path


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "evs.launch.main", "emulate", *SIZE, *words]


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}


def emulate(
    folder: Path, *words: str, before: Callable[[], None] | None = None
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(*words),
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=before,
    )


def record(folder: Path, name: str, *words: str) -> Any:
    """The events of 30 ticks of the ball, recorded under `name`."""
    ended = emulate(
        folder,
        *("--scene", "ball.xml", "--duration", "0.03", *MOVING),
        *("--record", name, "--force", *words),
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    return read(folder / name)


def report_of(path: Path) -> dict[str, Any]:
    fields: dict[str, Any] = json.loads(path.read_text())
    return fields


def test_one_run_into_two_files_that_hold_the_same_events(folder: Path) -> None:
    ended = emulate(
        folder,
        *("--scene", "ball.xml", "--duration", "0.03", "--seed", "7", *MOVING),
        *("--record", "run.aedat4", "sink.0.type=npz", "sink.0.file=run.npz"),
        *("--report", "report.json"),
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    events, same = read(folder / "run.aedat4"), read(folder / "run.npz")
    assert len(events) > 100
    assert events.tobytes() == same.tobytes()
    assert events["t"].min() > 0
    assert events["t"].max() <= 30_000
    assert np.all(np.diff(events["t"]) >= 0)
    assert (events.stream.width, events.stream.height, events.stream.seed) == (48, 36, 7)
    with np.load(folder / "run.npz") as arrays:
        assert {"t", "x", "y", "p"} <= set(arrays.files)

    report = report_of(folder / "report.json")
    assert report_of(folder / "run.aedat4.report.json") == report
    assert report_of(folder / "run.npz.report.json") == report
    assert (report["ended"], report["ticks"], report["packets"]) == ("complete", 30, 30)
    assert report["events"] == len(events)
    assert report["sim_seconds"] == pytest.approx(0.03)
    assert report["events_dropped"] == report["clamps"] == 0
    assert report["seed"] == 7
    assert 0 < report["traced_fraction"] <= 1
    # every stage really took time; nothing is 0 because it was not measured
    assert all(taken["median"] > 0 for taken in report["stage_ms"].values())
    assert list(report["stage_ms"]) == ["world", "render", "sensor", "pack", "sink"]
    assert report["config"]["sensor"]["width"] == 48
    assert report["config"]["scene"]["control"] == "random"
    assert {"evs", "mujoco", "numpy"} <= set(report["versions"])
    assert report["cameras"][0]["camera_info"]["width"] == 48
    assert {said["type"] for said in report["sinks"]} == {"aedat4", "npz"}
    assert "physics step" in report["substeps"]
    # what is said at the end is what was done
    assert f"events            {len(events):,} " in ended.stdout
    assert " view run.npz -o run.gif" in ended.stdout
    # the configuration in the report is one that runs again
    again = folder / "again.json"
    again.write_text(json.dumps(report["config"]))
    assert json.loads(again.read_text())["seed"] == 7


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(folder: Path) -> None:
    one = record(folder, "one.aedat4", "--seed", "3", "--threads", "1")
    again = record(folder, "again.aedat4", "--seed", "3", "--threads", "1")
    assert (folder / "one.aedat4").read_bytes() == (folder / "again.aedat4").read_bytes()
    assert len(one) > 100
    assert one.tobytes() == again.tobytes()
    for words in (["--threads", "2"], ["render.incremental=false"], ["render.isa=portable"]):
        other = record(folder, "other.aedat4", "--seed", "3", *words)
        assert one.tobytes() == other.tobytes(), words
    # the seed reaches the pixels' thresholds
    assert one.tobytes() != record(folder, "four.aedat4", "--seed", "4").tobytes()


def test_a_pipeline_file_runs_and_the_command_line_wins(folder: Path, tmp_path: Path) -> None:
    (folder / "sub").mkdir()
    (folder / "sub" / "p.toml").write_text(
        "duration_s = 5.0\nrecord = 'here.npz'\n[scene]\nfile = '../ball.xml'\ncamera = 'eye'\n"
    )
    ended = emulate(folder, "sub/p.toml", "duration_s=0.004", "--quiet")
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
    report = report_of(folder / "sub" / "here.npz.report.json")
    assert report["ticks"] == 4
    assert report["cameras"][0]["name"] == "camera"


def test_a_physics_that_breaks_down_leaves_a_whole_recording(folder: Path) -> None:
    ended = emulate(
        folder, "--scene", "unstable.xml", "--duration", "5", "--record", "run.aedat4",
        "scene.control=random",
    )  # fmt: skip
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "spin" in ended.stderr
    assert "unstable at t = " in ended.stderr
    assert "Traceback" not in ended.stderr
    report = report_of(folder / "run.aedat4.report.json")
    assert report["ended"].startswith("error at ")
    assert 0 < report["ticks"] < 5000
    events = read(folder / "run.aedat4")
    assert len(events) == report["events"] > 0
    assert events["t"].max() <= report["ticks"] * 1000


def small_files() -> None:
    """As on a disk with 20 kB left (Python ignores the signal, so writing fails with an error)."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))


def test_a_full_disk_is_one_line_and_what_was_recorded_is_readable(folder: Path) -> None:
    ended = emulate(
        folder,
        *("--scene", "ball.xml", "--duration", "5", "scene.control=random"),
        *("sink.0.type=aedat4", "sink.0.file=run.aedat4", "sink.0.compression=none"),
        before=small_files,
    )
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "run.aedat4" in ended.stderr
    report = report_of(folder / "run.aedat4.report.json")
    assert report["ended"].startswith("error at ")
    events = read(folder / "run.aedat4")
    assert 0 < len(events) <= report["events"]


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")],
)
def test_a_signal_ends_a_run_that_loses_nothing(
    folder: Path, number: signal.Signals, code: int, word: str
) -> None:
    words = ["--scene", "ball.xml", "--duration", "3600", "scene.control=random"]
    running = subprocess.Popen(
        command(*words, "--record", "run.aedat4"),
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    # a watchdog, so that a run that cannot be stopped fails the test instead of hanging it
    watchdog = threading.Timer(60, running.kill)
    watchdog.start()
    try:
        while running.poll() is None:
            file = folder / "run.aedat4"
            if file.exists() and file.stat().st_size > 20_000:
                break
            time.sleep(0.01)
        running.send_signal(number)
        told, complaint = running.communicate()
    finally:
        watchdog.cancel()
        running.kill()
    assert (running.returncode, complaint) == (code, "")
    report = report_of(folder / "run.aedat4.report.json")
    assert report["ended"].startswith(f"{word} at ")
    assert f"ended             {word} at " in told
    events = read(folder / "run.aedat4")
    assert len(events) == report["events"] > 0
    assert events["t"].max() <= report["ticks"] * 1000


def test_real_time_is_no_faster_than_the_wall_clock(folder: Path) -> None:
    words = ["--scene", "ball.xml", "--duration", "0.3", "--report", "report.json"]
    assert emulate(folder, *words, "--pace", "realtime").returncode == 0
    report = report_of(folder / "report.json")
    assert report["real_time_factor"] <= 1.0
    assert report["wall_seconds"] >= 0.3
