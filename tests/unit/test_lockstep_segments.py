"""Sinks beside a loop whose time jumps: a file for each stretch, live ones go on, failures told."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from evs.drivers.lockstep import segments
from evs.drivers.lockstep.running import LoopWithSinks
from evs.drivers.lockstep.segments import Segments, segment_path
from evs.drivers.pace import Pacer, StopWatch
from evs.drivers.pipeline.config import PIPELINES, SinkConfig
from evs.drivers.sink import SinkStoppedError
from evs.emulator import Loop
from evs.msgs import EventPacket, EvsError, StreamInfo

SCENE = str(Path(PIPELINES).parent / "scenes" / "cartpole.xml")
FILE = SinkConfig(type="aedat4", file="run.aedat4")
LIVE = SinkConfig(type="zmq", address="tcp://127.0.0.1:0")


class Noting:
    """A sink that notes what happens to it."""

    def __init__(self, name: str, diary: list[str], errors: dict[str, EvsError]) -> None:
        self.name, self.diary, self.errors = name, diary, errors
        self.packets: list[EventPacket] = []

    def open(self, streams: Sequence[StreamInfo]) -> None:
        self.diary.append(f"{self.name} open {streams[0].seed}")
        if "open" in self.errors and "002" in self.name:
            raise self.errors["open"]

    def write(self, packet: EventPacket) -> None:
        self.packets.append(packet)
        if "write" in self.errors and len(self.packets) == 3:
            raise self.errors["write"]

    def close(self) -> dict[str, Any]:
        self.diary.append(f"{self.name} close {len(self.packets)}")
        return {"type": self.name, "packets": len(self.packets)}


class Bench:
    """A real loop with noting sinks beside it."""

    def __init__(
        self, patch: pytest.MonkeyPatch, tables: Sequence[SinkConfig], **errors: EvsError
    ) -> None:
        self.diary: list[str] = []
        self.lines: list[str] = []
        self.made: list[Noting] = []

        def make(table: SinkConfig) -> Noting:
            self.made.append(Noting(table.file or table.type, self.diary, errors))
            return self.made[-1]

        patch.setattr(segments, "make_sink", make)
        loop = Loop(SCENE, sensor="dvs128", threads=1)
        watch = StopWatch()
        beside = Segments(tables, watch, self.lines.append)
        self.loop = LoopWithSinks(loop, beside, watch, Pacer(), self.lines.append)
        beside.open(loop.streams)


def test_each_stretch_of_time_has_its_file_and_live_sinks_go_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench(monkeypatch, [LIVE, FILE])
    loop = bench.loop
    # nothing was written, but the header knows the seed
    loop.reset(seed=4)
    loop.step([0.1], 3)
    loop.reset()
    loop.reset(seed=4)
    loop.step([0.1], 2)
    loop.reset(seed=5)
    assert loop.segments.close() is None
    assert bench.diary == [
        *("zmq open 0", "run.aedat4 open 0", "run.aedat4 close 0", "run.aedat4 open 4"),
        *("run.aedat4 close 3", "run-episode-002.aedat4 open 4", "run-episode-002.aedat4 close 2"),
        *("run-episode-003.aedat4 open 5", "run-episode-003.aedat4 close 0", "zmq close 5"),
    ]
    # an episode without a tick leaves no report behind
    assert loop.segments.files == ["run.aedat4", "run-episode-002.aedat4"]
    assert [said["packets"] for said in loop.segments.said] == [5, 3, 2]
    live = bench.made[0].packets
    assert [packet.seq for packet in live] == [0, 1, 2, 0, 1]
    # the same seed and controls: the same bytes in both
    assert live[0].events.tobytes() == live[3].events.tobytes()
    assert loop.account.ticks == 5
    assert loop.sim_seconds == pytest.approx(0.005)


def test_a_full_disk_is_told_and_the_controller_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    full = SinkStoppedError("the disk is full")
    bench = Bench(monkeypatch, [FILE], write=full)
    bench.loop.reset()
    assert bench.loop.step([0.0], 5).t_us == 5000
    assert bench.lines == ["the disk is full"]
    assert bench.loop.failure is None
    assert len(bench.made[-1].packets) == 3


def test_a_sink_that_fails_does_not_look_as_if_the_loop_had_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench(monkeypatch, [FILE], write=EvsError("broken"))
    bench.loop.reset()
    assert bench.loop.step([0.0], 5).t_us == 5000
    assert str(bench.loop.failure) == "broken"


def test_so_does_one_that_cannot_begin_another_file(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, [FILE], open=EvsError("no place"))
    bench.loop.reset()
    bench.loop.step([0.0])
    assert bench.loop.reset().t_us == 0
    assert str(bench.loop.failure) == "no place"


def test_what_the_loop_refuses_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, [FILE])
    bench.loop.reset()
    bench.loop.step([0.0], 2)
    with pytest.raises(EvsError, match="keyframe"):
        bench.loop.reset(keyframe="nowhere")
    bench.loop.step([0.0])
    assert bench.loop.segments.close() is None
    assert bench.diary[-1] == "run.aedat4 close 3"


def test_names_of_segments() -> None:
    assert segment_path("a/b.c.npz", 1) == "a/b.c.npz"
    assert segment_path("a/b.c.npz", 12) == "a/b.c-episode-012.npz"
