"""Worker sinks under pressure: a full ring, a full disk, a process that dies, a second Ctrl-C."""

from __future__ import annotations

import os
import resource
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.bus import subscribe
from evs.drivers.bus.address import free_address
from evs.drivers.files import read
from evs.drivers.run.config import make_sink
from evs.drivers.run.sink_set import SinkSet
from evs.drivers.run.worker import WorkerSink
from evs.drivers.sink import SinkStoppedError
from evs.drivers.sink_config import SinkConfig
from evs.emulator.base.protocols import NoMeter
from reference.worker_packets import EVENTS, INFO, is_there, packet, soon, worker_sink, write_on

pytestmark = pytest.mark.integration


@pytest.fixture
def stopped_sink(tmp_path: Path) -> Iterator[WorkerSink]:
    """A recorder whose process is held, with a ring of 100 kB."""
    sink = worker_sink(type="aedat4", file=str(tmp_path / "run.aedat4"), worker_mb=0.1)
    sink.open([INFO])
    os.kill(sink.process, signal.SIGSTOP)
    yield sink
    sink.close()


def test_a_recorder_is_waited_for_and_loses_nothing(
    tmp_path: Path, stopped_sink: WorkerSink
) -> None:
    process = stopped_sink.process
    sent = [packet(seq, 1000) for seq in range(30)]

    def go_on() -> None:
        soon(lambda: stopped_sink._ring.free == 0)
        time.sleep(0.3)
        os.kill(process, signal.SIGCONT)

    freeing = threading.Thread(target=go_on)
    freeing.start()
    for one in sent:
        stopped_sink.write(one)
    freeing.join()
    said = stopped_sink.close()
    assert said["events"] == 30_000
    assert said["worker_waits"] >= 1
    assert said["worker_waited_s"] > 0.1
    assert not said["error"]
    found = read(tmp_path / "run.aedat4")
    assert found["t"].tolist() == np.concatenate([one.events["t"] for one in sent]).tolist()
    assert not is_there(process)
    # safe to call twice
    assert stopped_sink.close() == said


def test_a_packet_larger_than_the_ring_is_recorded_all_the_same(tmp_path: Path) -> None:
    file = tmp_path / "run.aedat4"
    sink = worker_sink(type="aedat4", file=str(file), worker_mb=0.01)
    sink.open([INFO])
    sent = [packet(seq, 20_000 * (seq % 2)) for seq in range(6)]
    for one in sent:
        sink.write(one)
    assert sink.close()["events"] == 60_000
    assert read(file)["x"].tolist() == np.concatenate([one.events["x"] for one in sent]).tolist()


def test_a_live_sink_never_slows_the_camera_and_its_losses_are_counted() -> None:
    address = free_address()
    with subscribe(address, "eye", timeout_s=20) as stream:
        sink = worker_sink(type="zmq", address=address, wait_for=1, worker_mb=0.1)
        sink.open([INFO])
        os.kill(sink.process, signal.SIGSTOP)
        begin_s = time.monotonic()
        for seq in range(200):
            sink.write(packet(seq, 1000))
        assert time.monotonic() - begin_s < 5
        os.kill(sink.process, signal.SIGCONT)
        # there is room again, and the next one shows the gap
        soon(lambda: sink._ring.free == sink._ring.capacity)
        sink.write(packet(200, 1000))
        said: dict[str, Any] = {}
        closing = threading.Thread(target=lambda: said.update(sink.close()))
        closing.start()
        got = sum(len(one) for one in stream)
        closing.join(20)
    dropped = said["worker_packets_dropped"]
    assert 150 < dropped < 200
    assert said["events_dropped"] == 1000 * dropped
    assert stream.lost == dropped
    assert got == 1000 * (201 - dropped)
    assert said["packets_sent"] == 201 - dropped


def test_a_packet_that_a_live_ring_never_holds_is_dropped() -> None:
    sink = worker_sink(type="zmq", address="tcp://127.0.0.1:0", worker_mb=0.01)
    sink.open([INFO])
    sink.write(packet(0, 1000))
    sink.write(packet(1, 100))
    said = sink.close()
    assert (said["worker_packets_dropped"], said["events_dropped"]) == (1, 1000)


def test_a_process_that_dies_is_a_sink_that_stopped_and_the_others_go_on(tmp_path: Path) -> None:
    file, other = tmp_path / "run.aedat4", tmp_path / "other.npz"
    dies = worker_sink(type="aedat4", file=str(file))
    warnings: list[str] = []
    sinks = SinkSet(
        [dies, make_sink(SinkConfig.of(type="npz", file=str(other)))], NoMeter(), warnings.append
    )
    sinks.open([INFO])
    sinks.write([packet(0)])
    soon(lambda: dies._ring.free == dies._ring.capacity)
    soon(lambda: file.stat().st_size > 2000)
    os.kill(dies.process, signal.SIGKILL)
    written = 1

    def warned() -> list[str]:
        nonlocal written
        sinks.write([packet(written)])
        written += 1
        return warnings

    soon(warned)
    line = (
        f"the process of the aedat4 sink '{file}' was ended by signal 9: what it wrote until then "
        "is there, what comes now is not; start the run again to have it all"
    )
    assert warnings == [line]
    assert sinks.close() is None
    assert sinks.reports[0]["error"] == line
    assert sinks.reports[0]["type"] == "aedat4"
    assert len(read(other)) == written * EVENTS
    assert len(read(file)) == EVENTS


def test_a_process_that_dies_at_the_end_is_told_too(tmp_path: Path) -> None:
    sink = worker_sink(type="aedat4", file=str(tmp_path / "run.aedat4"))
    warnings: list[str] = []
    sinks = SinkSet([sink], NoMeter(), warnings.append)
    sinks.open([INFO])
    sinks.write([packet(0)])
    os.kill(sink.process, signal.SIGKILL)
    assert sinks.close() is None
    assert [line for line in warnings if "was ended by signal 9" in line] == warnings != []
    assert sinks.reports[0]["error"] == warnings[0]


def test_a_full_disk_stops_it_as_it_stops_one_that_is_not_aside(tmp_path: Path) -> None:
    file = tmp_path / "run.aedat4"
    sink = worker_sink(type="aedat4", file=str(file))
    sink.prepare()
    # a limit on a file's size is the same to a process: a short write, then an error
    resource.prlimit(sink.process, resource.RLIMIT_FSIZE, (50_000, 50_000))
    sink.open([INFO])
    with pytest.raises(SinkStoppedError, match=r"recording to .*run.aedat4 stopped after"):
        write_on(sink, 0)
    said = sink.close()
    assert "run.aedat4 stopped after" in said["error"]
    assert len(read(file)) == said["events"] > 0


def test_a_wait_that_is_interrupted_leaves_the_recording_whole(
    tmp_path: Path, stopped_sink: WorkerSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("evs.drivers.run.worker.sink.sleep_s", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_on(stopped_sink, 0, 1000)
    taken = (100_000 - stopped_sink._ring.free) // (16 * 1000 + 64)
    assert 0 < taken < 10
    # nothing can follow the torn one
    with pytest.raises(SinkStoppedError, match="interrupted in the middle of a packet"):
        stopped_sink.write(packet(taken))
    os.kill(stopped_sink.process, signal.SIGCONT)
    said = stopped_sink.close()
    assert said["events"] == 1000 * taken
    assert "was interrupted in the middle of a packet" in said["error"]
    assert len(read(tmp_path / "run.aedat4")) == 1000 * taken
