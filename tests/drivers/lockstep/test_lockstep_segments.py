"""Sinks beside a loop whose time jumps: a file for each stretch, live ones go on, failures told."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.clock import Pacer, StopWatch
from evs.drivers.lockstep import segments
from evs.drivers.lockstep.segments import Segments, camera_path, segment_path
from evs.drivers.lockstep.serve import ServedRun
from evs.drivers.run.config import PIPELINES
from evs.drivers.sink import Sink, SinkStoppedError
from evs.drivers.sink_config import SinkConfig
from evs.emulator import ClosedLoop
from evs.emulator.config import ApsConfig, SensorConfig
from evs.msgs import EventPacket, EvsError, StreamInfo

SCENE = str(PIPELINES.parent / "scenes" / "cartpole.xml")
FILE = SinkConfig.of(type="aedat4", file="run.aedat4")
LIVE = SinkConfig.of(type="zmq", address="tcp://127.0.0.1:0")


class Noting(Sink):
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
            self.made.append(Noting(table.path or table.type, self.diary, errors))
            return self.made[-1]

        patch.setattr(segments, "make_sink", make)
        loop = ClosedLoop(SCENE, sensor="dvs128", threads=1)
        watch = StopWatch()
        beside = Segments(tables, watch, self.lines.append)
        self.loop = ServedRun(loop, beside, watch, Pacer(), self.lines.append)
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
    assert [said["packets"] for said in loop.segments.reports] == [5, 3, 2]
    live = bench.made[0].packets
    assert [packet.seq for packet in live] == [0, 1, 2, 0, 1]
    # the same seed and controls: the same bytes in both
    assert live[0].events.tobytes() == live[3].events.tobytes()
    assert loop.statistics.ticks == 5
    assert loop.sim_seconds == pytest.approx(0.005)


@pytest.mark.parametrize(
    "table",
    [
        SinkConfig.of(type="rerun", rrd="run.rrd"),
        SinkConfig.of(type="foxglove", mcap="run.mcap"),
    ],
)
def test_files_of_viewers_are_one_a_stretch_too(
    monkeypatch: pytest.MonkeyPatch, table: SinkConfig
) -> None:
    bench = Bench(monkeypatch, [table])
    loop = bench.loop
    loop.reset(seed=4)
    loop.step([0.1], 3)
    loop.reset(seed=5)
    loop.step([0.1], 2)
    assert loop.segments.close() is None
    suffix = Path(table.path or "").suffix
    assert loop.segments.files == [f"run{suffix}", f"run-episode-002{suffix}"]
    assert f"run-episode-002{suffix} close 2" in bench.diary


def test_a_full_disk_is_told_and_the_controller_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    full = SinkStoppedError("the disk is full")
    bench = Bench(monkeypatch, [FILE], write=full)
    bench.loop.reset()
    assert bench.loop.step([0.0], 5).t_us == 5000
    assert bench.lines == ["the disk is full"]
    assert bench.loop.segments.failure is None
    assert len(bench.made[-1].packets) == 3


def test_a_sink_that_fails_does_not_look_as_if_the_loop_had_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench(monkeypatch, [FILE], write=EvsError("broken"))
    bench.loop.reset()
    assert bench.loop.step([0.0], 5).t_us == 5000
    assert str(bench.loop.segments.failure) == "broken"


def test_so_does_one_that_cannot_begin_another_file(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, [FILE], open=EvsError("no place"))
    bench.loop.reset()
    bench.loop.step([0.0])
    assert bench.loop.reset().t_us == 0
    assert str(bench.loop.segments.failure) == "no place"


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
    assert camera_path("a/b.c.npz", "left") == "a/b.c-left.npz"
    assert camera_path("run.raw", "walker/ego centric") == "run-walker_ego_centric.raw"


def test_each_of_two_cameras_has_files_of_its_own(tmp_path: Path) -> None:
    sensor = SensorConfig("dvs128", aps=ApsConfig(enabled=True))
    loop = ClosedLoop(SCENE, ("watch", "onboard"), sensor=sensor, threads=1)
    watch, lines = StopWatch(), list[str]()
    tables = [
        SinkConfig.of(type="aedat4", file=str(tmp_path / "run.aedat4")),
        SinkConfig.of(type="npz", file=str(tmp_path / "run.npz")),
    ]
    beside = ServedRun(loop, Segments(tables, watch, lines.append), watch, Pacer(), print)
    beside.segments.open(loop.streams)
    beside.reset(seed=1)
    seen = beside.step([0.5], 60)
    beside.reset(seed=2)
    beside.step([0.5], 3)
    assert beside.segments.close() is None
    assert lines == []
    names = [f"run-{name}{end}" for end in (".aedat4", ".npz") for name in ("watch", "onboard")]
    later = [name.replace(".", "-episode-002.") for name in names]
    assert [Path(name).name for name in beside.segments.files] == [*names, *later]
    for name in ("watch", "onboard"):
        sent = np.concatenate([one.events for one in seen.packets if one.camera == name])
        frames = [one for one in seen.frames if one.camera == name]
        assert len(sent) > 100
        assert frames
        for end in (".aedat4", ".npz"):
            stored = files.read(tmp_path / f"run-{name}{end}")
            np.testing.assert_array_equal(stored, sent)
            assert [one.pixels.tobytes() for one in stored.frames] == [
                one.pixels.tobytes() for one in frames
            ]


def test_two_cameras_that_would_share_a_file_are_refused(tmp_path: Path) -> None:
    tables = [
        SinkConfig.of(type="aedat4", file=str(tmp_path / name))
        for name in ("run.aedat4", "run-left.aedat4")
    ]
    infos = [StreamInfo(8, 8, "left"), StreamInfo(8, 8, "left/left")]
    with pytest.raises(EvsError, match="are one file"):
        Segments([tables[0], tables[0]], StopWatch(), print).open(infos)
    beside = Segments(tables, StopWatch(), print)
    beside.open(infos)
    assert beside.close() is None
