"""A full disk stops a recording; the camera, and whoever else listens to it, go on."""

from __future__ import annotations

import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers.files import read, summary
from evs.drivers.files.multi_file import later_parts
from evs.drivers.search_path import search_path
from reference.mjcf import BAR

pytestmark = pytest.mark.extremes

ROOM = 64 * 1024
TICKS = 400


def can_mount(folder: Path) -> bool:
    """Whether a process of ours may mount a small file system, seen by itself alone."""
    if shutil.which("unshare") is None:
        return False
    words = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c"]
    mount = f"mount -t tmpfs -o size={ROOM} tmpfs {shlex.quote(str(folder))}"
    return subprocess.run([*words, mount], capture_output=True, check=False).returncode == 0


def on_full_disk(folder: Path, disk: Path, command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run it with 64 kB of room in `disk`, whose files come out beside it, under `kept`.

    A tmpfs where one can be mounted, else a limit on a file's size, which is the same to a process:
    a short write, then an error.
    """
    environment = {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}
    kept = folder / "kept"
    kept.mkdir()
    disk.mkdir()
    before = None
    if can_mount(disk):
        quoted = shlex.join(command)
        script = (
            f"mount -t tmpfs -o size={ROOM} tmpfs {shlex.quote(str(disk))} || exit 99; "
            f"{quoted}; code=$?; cp {shlex.quote(str(disk))}/* {shlex.quote(str(kept))}; exit $code"
        )
        command = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script]
    else:
        kept.rmdir()
        kept.symlink_to(disk)

        def before() -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, ROOM))

    return subprocess.run(
        command,
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=before,
        check=False,
    )


@pytest.mark.parametrize(
    ("compression", "rotate"),
    [
        ("none", ["sink.0.worker=true"]),
        pytest.param("none", [], marks=pytest.mark.slow),
        pytest.param("lz4", [], marks=pytest.mark.slow),
        pytest.param("zstd", [], marks=pytest.mark.slow),
        ("lz4", ["sink.0.rotate_mb=0.02"]),
    ],
)
def test_the_camera_goes_on(tmp_path: Path, compression: str, rotate: list[str]) -> None:
    (tmp_path / "ball.xml").write_text(BAR.format(speed=40))
    disk = tmp_path / "disk"
    words = ["emulate", "--scene", "ball.xml", "sensor.width=96", "sensor.height=72", "--seed", "1"]
    words += ["scene.keyframe=fast", "--duration", str(TICKS / 1000), "--report", "report.json"]
    words += ["sink.0.type=aedat4", f"sink.0.file={disk}/run.aedat4"]
    words += [f"sink.0.compression={compression}", *rotate, "--publish", "tcp://127.0.0.1:0"]
    ended = on_full_disk(tmp_path, disk, [sys.executable, "-m", "evs.launch.main", *words])
    # not all of it was recorded: said once, at once, and by the exit code
    assert ended.returncode == 2, ended.stderr
    lines = [line for line in ended.stderr.splitlines() if "stopped after" in line]
    assert len(lines) == 1
    assert "run.aedat4" in lines[0]
    assert "the events before that are readable" in lines[0]
    # the camera made every tick, and the bus got every packet
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["ended"], report["ticks"]) == ("complete", TICKS)
    bus, recorder = report["sinks"]
    assert bus["packets_unsubscribed"] == TICKS
    assert "stopped after" in recorder["error"]
    # everything before it is readable
    first = tmp_path / "kept" / "run.aedat4"
    parts = [first, *later_parts(first)]
    assert (len(parts) > 1) == ("sink.0.rotate_mb=0.02" in rotate)
    assert len(read(first)) == recorder["events"] > 1000
    assert recorder["events"] < report["events"]
    for part in parts:
        found = summary(part)
        assert (found.torn_at, found.damaged_packets) == (None, 0)


def test_a_recording_alone_ends_with_its_disk(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(BAR.format(speed=40))
    disk = tmp_path / "disk"
    words = ["emulate", "--scene", "ball.xml", "sensor.width=96", "sensor.height=72"]
    words += ["scene.keyframe=fast", "--duration", "60", "--record", f"{disk}/run.aedat4"]
    words += ["--report", "report.json"]
    ended = on_full_disk(tmp_path, disk, [sys.executable, "-m", "evs.launch.main", *words])
    assert ended.returncode == 2
    assert ended.stderr.count("stopped after") == 1
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["ended"].startswith("error at ")
    assert len(read(tmp_path / "kept" / "run.aedat4")) == report["sinks"][0]["events"] > 0
