"""Worker sinks: the same files, the same errors, the same report, from a process of their own."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.bus import request, subscribe
from evs.drivers.bus.address import free_address
from evs.drivers.files import formats, read
from evs.drivers.run.config import make_sink
from evs.drivers.sink_config import SinkConfig
from evs.emulator.base.scene import GroundTruth
from evs.msgs import EvsError, Pace, Pose
from reference.worker_packets import (
    EVENTS,
    HEIGHT,
    INFO,
    WIDTH,
    feed,
    is_there,
    packet,
    soon,
    worker_sink,
    write_on,
)

pytestmark = pytest.mark.integration

KINDS = {each.name: each for each in formats.RECORDED}


@pytest.mark.parametrize("kind", ["aedat4", "npz", "csv", "aedat2", "aedat3", "hdf5", "rosbag2"])
def test_files_have_the_same_bytes(tmp_path: Path, kind: str) -> None:
    holds, suffix = KINDS[kind].capabilities, KINDS[kind].suffixes[0]
    info = replace(INFO, frames=holds.frames, imu=holds.imu, triggers=holds.triggers)
    # a bag holds its own name
    files = [tmp_path / folder / f"run{suffix}" for folder in ("here", "worker")]
    for file in files:
        file.parent.mkdir()
    tables = [SinkConfig.of(type=kind, file=str(file)) for file in files]
    sinks = [make_sink(tables[0]), make_sink(replace(tables[1], worker=True))]
    fed = feed(sinks, info, 40, labels=holds.labels)
    here, there = fed.reports
    assert there == {**here, "path": str(files[1]), "worker_waits": 0, "worker_waited_s": 0.0}
    assert files[0].read_bytes() == files[1].read_bytes()
    assert len(read(files[1])) == 40 // 4 * EVENTS * 6


@pytest.mark.slow
def test_a_port_in_use_and_a_folder_that_is_not_there_are_the_same_one_line(
    tmp_path: Path,
) -> None:
    address = free_address()
    taken = make_sink(SinkConfig.of(type="zmq", address=address))
    taken.open([INFO])
    for table, streams in (
        (SinkConfig.of(type="zmq", address=address), [INFO]),
        (SinkConfig.of(type="zmq", address=free_address(), wait_for=1, wait_s=0.1), [INFO]),
        (SinkConfig.of(type="aedat4", file=str(tmp_path / "none" / "a.aedat4")), [INFO]),
        (SinkConfig.of(type="aedat4", file=str(tmp_path / "a.aedat4")), [INFO, INFO]),
    ):
        lines = []
        for way in (False, True):
            sink = make_sink(replace(table, worker=way))
            with pytest.raises(EvsError) as error:
                sink.open(streams)
            lines.append(str(error.value))
            sink.close()
        assert lines[0] == lines[1]
        assert "\n" not in lines[1]
    taken.close()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"type": "aedat4", "file": "a.aedat4", "compression": "lzma"}, "lzma"),
        ({"type": "zmq", "address": "tcp://127.0.0.1:1", "queue": 0}, "queue is 0"),
        ({"type": "npz", "file": "a.npz", "worker_mb": 0.0}, "worker_mb is 0: give the MB"),
        ({"type": "npz", "file": "a.npz", "worker_mb": 1e9}, "worker_mb is 1e\\+09: give the MB"),
    ],
)
def test_a_bad_value_is_told_before_any_process_starts(given: dict[str, Any], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        worker_sink(**given)


def test_cores_that_are_not_there_are_refused(tmp_path: Path) -> None:
    sink = worker_sink(type="npz", file=str(tmp_path / "a.npz"), worker_cores=(4000,))
    with pytest.raises(EvsError, match=r"worker_cores is \[4000\]: choose of "):
        sink.open([INFO])
    assert sink.close()["type"] == "npz"


def test_its_process_runs_on_the_cores_that_it_may_use(tmp_path: Path) -> None:
    core = max(os.sched_getaffinity(0))
    sink = worker_sink(type="npz", file=str(tmp_path / "a.npz"), worker_cores=(core,))
    sink.open([INFO])
    assert os.sched_getaffinity(sink.process) == {core}
    sink.close()


def test_a_packet_that_breaks_its_promises_is_told_as_an_error() -> None:
    address = free_address()
    with subscribe(address, "eye"):
        sink = worker_sink(type="zmq", address=address, wait_for=1)
        sink.open([INFO])
        bad = packet(0)
        bad.events["x"] = WIDTH
        sink.write(bad)
        with pytest.raises(EvsError, match="events lie outside the 40x30 sensor"):
            write_on(sink, 1)
    sink.close()


def test_an_unknown_camera_is_refused_here(tmp_path: Path) -> None:
    sink = worker_sink(type="npz", file=str(tmp_path / "a.npz"))
    with pytest.raises(EvsError, match="not open"):
        sink.write(packet(0))
    sink.open([INFO])
    with pytest.raises(EvsError, match="no camera of this sink 'ear'; there is: eye"):
        sink.write(replace(packet(0), camera="ear"))
    sink.close()


def test_what_a_sink_wants_comes_back() -> None:
    """Poses while somebody listens to them, ground truth at its rate, and the wish to end."""
    address = free_address()
    options = {"poses": True, "truths": True}
    with subscribe(address, "eye", timeout_s=20, **options) as stream:
        sink = worker_sink(
            type="zmq", address=address, wait_for=1, control=free_address(), truth_hz=100.0
        )
        sink.open([INFO])
        planes = {
            key: np.zeros((HEIGHT, WIDTH, *more), kind)
            for key, kind, more in (
                ("depth", "f4", ()),
                ("distance", "f4", ()),
                ("normal", "f4", (3,)),
                ("position", "f4", (3,)),
                ("geom_id", "i4", ()),
                ("body_id", "i4", ()),
                ("flow", "f4", (2,)),
            )
        }
        truths = poses = 0
        for seq in range(400):
            t_us = 1000 * seq + 1000
            if sink.wants_pose("eye"):
                sink.write_pose(Pose(poses, t_us, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0), "eye"))
                poses += 1
            if sink.wants_truth("eye", t_us):
                sink.write_truth("eye", GroundTruth(t_us, **planes))
                truths += 1
            assert not sink.wants_light("eye", t_us)
            sink.write_pace(Pace(1.0, 5, 6, 7, seq))
            sink.write(packet(seq, 10))
            # it has taken all but is perhaps not done with the last
            soon(lambda: sink._ring.free == sink._ring.capacity)
        assert not sink.stop_wanted
        assert poses > 300
        # 40 are due in 400 ms; each is asked for when a packet says that it is
        assert 30 <= truths <= 41
        closing = threading.Thread(target=sink.close)
        closing.start()
        came = [0, 0]
        for _ in stream:
            came[0] += len(stream.poses)
            came[1] += len(stream.truths)
        closing.join(20)
    assert came[0] + len(stream.poses) == poses
    assert came[1] + len(stream.truths) == truths
    assert stream.status is not None
    assert stream.status.pace == Pace(1.0, 5, 6, 7, 399)


def test_a_client_of_the_control_port_may_end_the_run() -> None:
    address = free_address()
    sink = worker_sink(type="zmq", address="tcp://127.0.0.1:0", control=address)
    sink.open([INFO])
    assert not sink.stop_wanted
    asked = threading.Thread(target=lambda: request(address, "stop"))
    asked.start()
    seq = 0
    until = time.monotonic() + 20
    while not sink.stop_wanted and time.monotonic() < until:
        sink.write(packet(seq, 1))
        seq += 1
        time.sleep(0.002)
    assert sink.stop_wanted
    asked.join(20)
    sink.close()


def test_one_that_is_never_opened_leaves_no_process(tmp_path: Path) -> None:
    sink = worker_sink(type="aedat4", file=str(tmp_path / "run.aedat4"))
    assert sink.process == 0
    assert sink.close() == {"type": "aedat4"}
    sink.prepare()
    process = sink.process
    assert is_there(process)
    sink.close()
    assert not is_there(process)
    assert not (tmp_path / "run.aedat4").exists()


def test_one_that_is_closed_says_so() -> None:
    sink = worker_sink(type="zmq", address="tcp://127.0.0.1:0")
    pace = Pace(1.0, 0, 0, 0, 0)
    with pytest.raises(EvsError, match="not open"):
        sink.write_pace(pace)
    sink.open([INFO])
    sink.write_pace(pace)
    sink.close()
    with pytest.raises(EvsError, match="not open"):
        sink.write_pace(pace)
    assert not sink.stop_wanted
    assert not sink.wants_pose("eye")


def test_no_process_to_be_had_leaves_nothing_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("evs.drivers.run.worker.process.subprocess.Popen", refuse)
    before = sorted(Path("/proc/self/fd").iterdir())
    sink = worker_sink(type="npz", file=str(tmp_path / "a.npz"))
    with pytest.raises(EvsError, match=r"cannot start a process .*: Resource temporarily"):
        sink.open([INFO])
    assert sink.close() == {"type": "npz"}
    assert sorted(Path("/proc/self/fd").iterdir()) == before


def test_the_run_wide_word_is_every_sink_that_says_nothing_else() -> None:
    from evs.drivers.run.config import PipelineConfig, check
    from evs.emulator.config import SceneConfig

    tables = (
        SinkConfig.of(type="npz", file="a.npz"),
        SinkConfig.of(type="csv", file="a.csv", worker=False),
    )
    config = PipelineConfig(
        sink=tables, record="b.npz", worker=True, scene=SceneConfig(file="a.xml")
    )
    assert [sink.worker for sink in config.sinks()] == [True, False, True]
    assert [sink.worker for sink in replace(config, worker=False).sinks()] == [None, False, None]
    check(config)
    lonely = replace(config, worker=False, sink=(replace(tables[0], worker_mb=3.0),))
    with pytest.raises(EvsError, match=r"at sink.0.worker_mb: needs worker = true"):
        check(lonely)
