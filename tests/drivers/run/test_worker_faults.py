"""Worker sinks in whole runs: whoever is killed, what was handed over is written; nobody stays."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from evs.drivers.bus.address import free_address
from evs.drivers.files import read, summary
from evs.drivers.search_path import search_path
from reference.mjcf import BAR

pytestmark = pytest.mark.integration


QUIET = ("--quiet", "sensor.width=48", "sensor.height=36", "scene.keyframe=fast")
ENDLESS = ("--duration", "600", "--pace", "realtime")


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bar.xml").write_text(BAR.format(speed=20))
    return tmp_path


@contextmanager
def emulating(folder: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """`evs emulate`, as a terminal starts it: in a process group of its own."""
    program = [sys.executable, "-m", "evs.launch.main", "emulate", "--scene", "bar.xml", *QUIET]
    with subprocess.Popen(
        [*program, *words],
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as running:
        try:
            yield running
        finally:
            running.kill()


def soon(what: Callable[[], object], seconds: float = 60.0) -> None:
    until = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < until, "it never came"
        time.sleep(0.01)


def workers_of(parent: int) -> list[int]:
    """The processes of its sinks."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text()
    return [int(word) for word in children.split()]


def lines_of(said: str) -> list[str]:
    """What it printed, without what depends on the load of this machine."""
    return [line for line in said.splitlines() if "this machine cannot keep up" not in line]


def is_there(process: int) -> bool:
    """Whether it runs: one that has ended stays in the list until somebody asks how."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


def size_of(file: Path) -> int:
    return file.stat().st_size if file.exists() else 0


def wait_for_packets(file: Path) -> None:
    """Wait until packets follow its header: the run goes, however long headers are."""
    soon(lambda: size_of(file))
    header = size_of(file)
    soon(lambda: size_of(file) > header)


def still(file: Path) -> bool:
    """Whether it grows no more."""
    before = size_of(file)
    time.sleep(0.5)
    return before > 0 and size_of(file) == before


def has_table(file: Path) -> bool:
    """Whether a recording was ended as it should be."""
    found = summary(file)
    return found.table and found.torn_at is None


def test_the_camera_is_killed_and_the_sink_writes_all_that_it_was_given(folder: Path) -> None:
    own, worker = folder / "own.aedat4", folder / "worker.aedat4"
    words = ("sink.0.type=aedat4", f"sink.0.file={own}", "sink.1.type=aedat4")
    words = (*words, f"sink.1.file={worker}", "sink.1.worker=true", "--pace", "realtime")
    with emulating(folder, "--duration", "1.5", *words) as camera:
        wait_for_packets(worker)
        (process,) = workers_of(camera.pid)
        os.kill(process, signal.SIGSTOP)
        # all ticks are made and in the ring; the camera waits for the sink to be closed
        soon(lambda: still(own))
        written = size_of(worker)
        camera.kill()
        camera.wait(20)
        os.kill(process, signal.SIGCONT)
        soon(lambda: not is_there(process))
    assert size_of(worker) > written
    assert has_table(worker)
    assert len(read(worker)) > 1000
    assert read(worker).tobytes() == read(own).tobytes()


def test_ctrl_c_ends_the_camera_and_the_sink_stays_until_all_is_written(folder: Path) -> None:
    file = folder / "run.aedat4"
    with emulating(folder, *ENDLESS, "--worker", "--record", str(file)) as camera:
        wait_for_packets(file)
        (process,) = workers_of(camera.pid)
        os.kill(process, signal.SIGSTOP)
        time.sleep(0.3)
        # to the whole group, as a terminal does; and one that somebody sends to everything
        os.killpg(camera.pid, signal.SIGINT)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(process, number)
        time.sleep(0.3)
        os.kill(process, signal.SIGCONT)
        said = camera.communicate(timeout=60)
    assert (camera.returncode, lines_of(said[1])) == (130, [])
    report = json.loads(Path(f"{file}.report.json").read_text())
    assert report["ended"].startswith("interrupted at")
    assert has_table(file)
    assert len(read(file)) == report["events"] == report["sinks"][0]["events"] > 0
    assert not is_there(process)


def test_the_sink_is_killed_and_the_camera_goes_on(folder: Path) -> None:
    own, worker = folder / "own.npz", folder / "worker.aedat4"
    words = ("sink.0.type=npz", f"sink.0.file={own}", "sink.1.type=aedat4")
    words = (*words, f"sink.1.file={worker}", "sink.1.worker=true", "--pace", "realtime")
    with emulating(folder, "--duration", "1.5", *words) as camera:
        wait_for_packets(worker)
        (process,) = workers_of(camera.pid)
        os.kill(process, signal.SIGKILL)
        _, said = camera.communicate(timeout=60)
    line = f"the process of the aedat4 sink '{worker}' was ended by signal 9: what it wrote until"
    assert camera.returncode == 2
    assert [line in one for one in lines_of(said)] == [True]
    report = json.loads(Path(f"{own}.report.json").read_text())
    assert (report["ended"], report["ticks"]) == ("complete", 1500)
    assert [line in one for one in lines_of("\n".join(report["warnings"]))] == [True]
    assert line in report["sinks"][1]["error"]
    whole, part = read(own), read(worker)
    assert 0 < len(part) < len(whole) == report["events"]
    assert part.tobytes() == whole[: len(part)].tobytes()


def test_the_only_sink_is_killed_and_that_ends_the_run(folder: Path) -> None:
    file = folder / "run.aedat4"
    with emulating(folder, *ENDLESS, "--worker", "--record", str(file)) as camera:
        wait_for_packets(file)
        os.kill(workers_of(camera.pid)[0], signal.SIGKILL)
        _, said = camera.communicate(timeout=60)
    assert camera.returncode == 2
    assert ["was ended by signal 9" in one for one in lines_of(said)] == [True]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_the_camera_goes_while_the_sink_waits_for_subscribers(
    folder: Path, number: signal.Signals
) -> None:
    bus = (f"publish={free_address()}", "publish_wait_for=1", "publish_wait_s=1000")
    with emulating(folder, "--worker", *bus) as camera:
        soon(lambda: workers_of(camera.pid))
        (process,) = workers_of(camera.pid)
        # it is past its imports: it has the port
        port = int(bus[0].rpartition(":")[2])
        soon(lambda: f":{port:04X} 00000000:0000 0A" in Path("/proc/net/tcp").read_text())
        os.kill(camera.pid, number)
        camera.communicate(timeout=20)
        soon(lambda: not is_there(process), 20)
    assert camera.returncode == (130 if number == signal.SIGINT else -signal.SIGKILL)


def test_every_worker_of_a_run_that_ends_by_itself(folder: Path) -> None:
    """Two recordings and a bus: the same report as without, and nobody is left."""
    words = ("--duration", "0.2", "--record", "run.aedat4", "sink.0.type=npz", "sink.0.file=a.npz")
    words = (*words, "--publish", "tcp://127.0.0.1:0", "--force")
    sinks = []
    for more in ((), ("--worker",)):
        with emulating(folder, *words, *more) as camera:
            said = camera.communicate(timeout=60)
        assert (camera.returncode, said) == (0, ("", ""))
        report = json.loads((folder / "run.aedat4.report.json").read_text())
        sinks.append(report["sinks"])
        assert report["events_dropped"] == 0
    for here, there in zip(*sinks, strict=True):
        more = {key: there.pop(key) for key in tuple(there) if key.startswith("worker_")}
        assert len(more) == 2
        assert not any(more.values())
        there.pop("events_dropped", None)
        assert {**there, "address": ""} == {**here, "address": ""}
