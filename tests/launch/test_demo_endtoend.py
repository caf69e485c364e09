"""`evs demo` from end to end: a robot, a second process, a file, pictures, and nothing lost."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from evs.drivers import files
from evs.launch.main import main
from evs.msgs.pictures import OFF_RGB, ON_RGB
from evs.tools.doctor import audit

pytestmark = pytest.mark.integration

QUICK = ["--duration", "0.05", "render.spp=1"]


def colours(path: Path, frame: int = 0) -> tuple[int, int]:
    """Pixels of ON's and OFF's colour."""
    with Image.open(path) as image:
        image.seek(frame)
        picture = np.asarray(image.convert("RGB"))
    on, off = (int(np.all(picture == c, axis=2).sum()) for c in (ON_RGB, OFF_RGB))
    return on, off


def test_the_main_job_in_short(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--out", "out/demo", *QUICK]) == 0
    out = tmp_path / "out" / "demo"
    names = {"events.aedat4", "report.json", "preview.png", "events.gif"}
    assert {path.name for path in out.iterdir()} == names
    # nothing beside the folder: no log, no temporary file
    assert [path.name for path in tmp_path.iterdir()] == ["out"]

    # every count agrees
    report: dict[str, Any] = json.loads((out / "report.json").read_text())
    events = files.read(out / "events.aedat4")
    assert report["faults"] == []
    assert report["ended"] == "complete"
    assert report["ticks"] == report["packets"] == report["subscriber"]["packets"] == 50
    assert report["events"] == report["subscriber"]["events"] == len(events) > 1000
    assert report["subscriber"]["lost"] == 0
    assert (events.stream.width, events.stream.height) == (346, 260)

    # the film is 0.05 s at 1/4, ON and OFF are in it beside the legend
    with Image.open(out / "events.gif") as film:
        assert film.n_frames == 5
    on, off = colours(out / "events.gif", 4)
    legend = colours(out / "events.gif", 0)
    assert on > legend[0] / 2
    assert off > legend[1] / 2
    with Image.open(out / "preview.png") as image:
        greys = np.asarray(image.convert("L"))[20:500, 20:1000]
    # a lit scene, not a flat page
    assert greys.std() > 40

    said = capsys.readouterr()
    assert said.err == ""
    for words in ("real-time factor", "render_ms", "50 packets and", "0 lost", "next:"):
        assert words in said.out


def test_a_subscriber_that_missed_something_fails_the_demo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = audit.Counter.totals

    def one_less(self: audit.Counter) -> dict[str, Any]:
        counted = real(self)
        return counted | {"packets": counted["packets"] - 1, "lost": 1}

    monkeypatch.setattr(audit.Counter, "totals", one_less)
    assert main(["demo", "--out", str(tmp_path), *QUICK]) == 1
    said = capsys.readouterr().err
    assert "evs: the demo failed: 50 packets were made, but 49 received" in said
    assert "the subscriber lost 1 packets" in said
    assert len(json.loads((tmp_path / "report.json").read_text())["faults"]) == 2


def test_a_recording_that_lacks_an_event_fails_the_demo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = files.read
    monkeypatch.setattr(files, "read", lambda path: real(path)[:-1])
    assert main(["demo", "--out", str(tmp_path), *QUICK]) == 1
    assert re.search(r"events were made, but [\d,]+ read back", capsys.readouterr().err)


def test_a_subscriber_that_cannot_start_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from evs.launch.commands import demo

    # a process that ends at once; the publisher need not wait its full time for it here
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    monkeypatch.setattr(demo, "SUBSCRIBER_S", 0.2)
    assert main(["demo", "--out", str(tmp_path), *QUICK]) == 2
    said = capsys.readouterr().err
    assert "the subscriber's process failed: exit code 1" in said
    assert said.count("\n") == 1


def evs(*words: str, **options: Any) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "evs.launch.main", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


@pytest.mark.slow
def test_interrupted_it_leaves_a_whole_recording(tmp_path: Path) -> None:
    process = evs("demo", "--out", str(tmp_path), "--duration", "20", start_new_session=True)
    recording = tmp_path / "events.aedat4"
    assert process.stderr is not None
    while process.poll() is None and (not recording.exists() or recording.stat().st_size < 200_000):
        time.sleep(0.01)
    # as a terminal does it: to every process of the group
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert re.search(r"the demo was interrupted at [\d.]+ s; .*events.aedat4 is whole", said)
    report = json.loads((tmp_path / "report.json").read_text())
    assert len(files.read(recording)) == report["events"] > 0


@pytest.mark.slow
def test_the_whole_demo_and_every_command_it_names(tmp_path: Path) -> None:
    process = evs("demo", cwd=tmp_path)
    out, err = process.communicate(timeout=600)
    assert (process.returncode, err) == (0, "")
    report = json.loads((tmp_path / "out" / "demo" / "report.json").read_text())
    assert report["ticks"] == 1000
    assert report["subscriber"]["packets"] == 1000
    with Image.open(tmp_path / "out" / "demo" / "events.gif") as film:
        assert film.n_frames == 100
    assert (tmp_path / "out" / "demo" / "events.gif").stat().st_size < 4_000_000
    commands = [line.strip() for line in out.split("next:")[1].splitlines() if line.strip()]
    assert len(commands) == 4
    for command in commands:
        # as printed, but for a tenth of the time
        command = command.replace(" emulate ", " emulate --duration 0.1 ")
        # the shell waits for what it put into the background too
        done = subprocess.run(
            f"set -e; {command}\nwait",
            shell=True,
            executable="/bin/sh",
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=600,
        )
        assert done.returncode == 0, (command, done.stderr)
        # a run first reports what it does with the robot's physics step and its keyframe; on a busy
        # machine `echo` says that it waits
        notes = (" physics step", "starts from keyframe", "it waits until a camera is there")
        said = [line for line in done.stderr.splitlines() if not any(n in line for n in notes)]
        assert "evs: " not in "".join(said), command
    assert (tmp_path / "out" / "demo" / "slow.gif").exists()
    assert (tmp_path / "out" / "demo" / "cart.aedat4").exists()
