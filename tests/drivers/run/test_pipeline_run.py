"""The run loop, with a world and sinks that fail on demand."""

from __future__ import annotations

import errno
import json
import os
import signal
import threading
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evs.drivers.clock import Pacer, StopWatch, sleep_s
from evs.drivers.run.report import STAGES, Report
from evs.drivers.run.run import Progress, run, tick_count
from evs.drivers.sink import Sink
from evs.emulator.base.protocols import Meter, NoMeter
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, StreamInfo, make_events

CALIBRATION = {"width": 4, "height": 3, "k": [1.0] * 9}


class FakeCamera:
    plan = SimpleNamespace(compact=lambda: {"on": ["sky"]})

    def __init__(self, name: str, dark: bool = False) -> None:
        self.info = StreamInfo(
            4, 3, camera=name, tick_us=1000, seed=5, versions={"mujoco": "4.0.0"},
            camera_info=CALIBRATION,
        )  # fmt: skip
        self.traced_fraction = 0.25
        self.is_dark = dark
        self.luminance = np.full((3, 4), 0.0 if dark else 0.5, np.float32)
        self.clamps = 0
        self.events_dropped: dict[str, int] = {}
        self.events_waiting = 0
        self.rebuilt = {"scenes": 0, "meshes": 0, "textures": 0}
        self.frames: tuple[Frame, ...] = ()
        self.imu_packet: ImuPacket | None = None


class FakeWorld:
    """Two events a tick and camera; `at` maps a tick to what happens in it."""

    substeps = "2 steps of 0.0005 s make a tick"
    left_out = ()

    def __init__(self, names: Sequence[str] = ("a",), dark: bool = False, **at: Any) -> None:
        self.cameras = [FakeCamera(name, dark) for name in names]
        self.meter: Meter = NoMeter()
        self.t_us, self.tick, self.at = 0, 0, at

    def step(self) -> tuple[EventPacket, ...]:
        if f"t{self.tick}" in self.at:
            happen = self.at[f"t{self.tick}"]
            if isinstance(happen, BaseException):
                raise happen
            happen()
        begin_us, self.t_us = self.t_us, self.t_us + 1000
        for stage in ("world", "render", "sensor"):
            self.meter.lap(stage)
        self.tick += 1
        stamps = [begin_us + 1, self.t_us]
        return tuple(
            EventPacket(
                self.tick - 1, begin_us, self.t_us, 4, 3,
                make_events(stamps, [0, 1], [2, 2], [1, 0]), camera.info.camera,
            )
            for camera in self.cameras
        )  # fmt: skip

    def finish(self) -> tuple[EventPacket, ...]:
        return ()


class FakeSink(Sink):
    """Notes what it is told in a shared diary; raises the errors it is given."""

    def __init__(self, name: str, diary: list[str], **errors: BaseException) -> None:
        self.name, self.diary, self.errors = name, diary, errors
        self.packets: list[EventPacket] = []
        self.infos: list[StreamInfo] = []

    def _do(self, what: str) -> None:
        self.diary.append(f"{self.name} {what}")
        if what in self.errors:
            raise self.errors[what]

    def open(self, streams: Sequence[StreamInfo]) -> None:
        self.infos = list(streams)
        self._do("open")

    def write(self, packet: EventPacket) -> None:
        if packet.seq == 2 and "write" in self.errors:
            raise self.errors["write"]
        self.packets.append(packet)

    def close(self) -> dict[str, Any]:
        self._do("close")
        return {"type": self.name, "packets": len(self.packets), "events_dropped": 1}


def full_disk() -> OSError:
    return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/media/x.aedat4")


def test_a_whole_run() -> None:
    world, diary = FakeWorld(("a", "b")), list[str]()
    world.cameras[0].clamps = world.cameras[1].clamps = 3
    sinks = [FakeSink("one", diary), FakeSink("two", diary)]
    watch = StopWatch()
    world.meter = watch
    moved: list[Progress] = []
    seen: list[tuple[int, int, int]] = []
    kept: list[Report] = []
    report = run(
        world,
        sinks,
        0.0208,
        watch,
        Pacer(),
        moved.append,
        [lambda tick, of, packets: seen.append((tick, of.t_us, len(packets)))],
        on_report=kept.append,
        config={"seed": 5},
    )
    # the whole ticks nearest to the duration
    assert report.ticks == 21
    assert world.tick == 21
    assert report.sim_seconds == pytest.approx(0.021)
    assert report.ended == "complete"
    assert (report.packets, report.events, report.events_dropped) == (42, 84, 2)
    assert report.traced_fraction == pytest.approx(0.25)
    assert report.clamps == 6
    assert report.real_time_factor == pytest.approx(0.021 / report.wall_seconds)
    assert tuple(report.stage_ms) == STAGES
    assert all(0 <= taken.median <= taken.p99 for taken in report.stage_ms.values())
    assert report.seed == 5
    assert report.substeps == FakeWorld.substeps
    assert report.config == {"seed": 5}
    assert report.versions["mujoco"] == "4.0.0"
    assert [camera["name"] for camera in report.cameras] == ["a", "b"]
    assert [camera["events"] for camera in report.cameras] == [42, 42]
    assert report.cameras[0]["camera_info"] == CALIBRATION
    assert report.cameras[0]["plan"] == {"on": ["sky"]}
    assert [said["type"] for said in report.sinks] == ["one", "two"]
    # each camera's once, when they begin
    assert [line.split(" were")[0] for line in report.warnings] == [
        f"camera '{name}': 3 values in tick 1" for name in "ab"
    ]
    assert kept == [report]
    for sink in sinks:
        assert [p.seq for p in sink.packets] == [k for k in range(21) for _ in "ab"]
        assert [info.camera for info in sink.infos] == ["a", "b"]
    # the last opened is closed first
    assert diary == ["one open", "two open", "two close", "one close"]
    assert [where.tick for where in moved] == list(range(1, 22))
    assert {where.ticks for where in moved} == {21}
    assert moved[-1].events == 84
    assert seen[0] == (1, 1000, 2)
    assert seen[-1] == (21, 21000, 2)


def test_what_a_readout_drops_is_in_the_report() -> None:
    world, sink = FakeWorld("ab"), FakeSink("file", [])
    world.cameras[0].events_dropped = {"roi": 0, "fifo": 40}
    world.cameras[0].events_waiting = 3
    world.cameras[0].rebuilt["scenes"] = 2
    world.cameras[1].events_dropped = {"roi": 2, "fifo": 5}
    report = run(world, [sink], 0.005)
    # one more is the sink's own
    assert (report.events_dropped, report.events_waiting) == (48, 3)
    assert [camera["events_dropped"] for camera in report.cameras] == [
        {"roi": 0, "fifo": 40},
        {"roi": 2, "fifo": 5},
    ]
    assert [camera["events_waiting"] for camera in report.cameras] == [3, 0]
    assert [camera["rebuilt"]["scenes"] for camera in report.cameras] == [2, 0]


def test_the_report_has_the_fields_of_the_design_and_is_json() -> None:
    fields = json.loads(run(FakeWorld(), [], 0.005).to_json())
    wanted = (
        "real_time_factor ticks sim_seconds wall_seconds events events_dropped stage_ms "
        "traced_fraction clamps seed versions config"
    )
    assert set(wanted.split()) <= set(fields)
    assert set(fields["stage_ms"]) == {"world", "render", "sensor", "pack", "sink"}
    assert set(fields["stage_ms"]["render"]) == {"median", "p99"}


@pytest.mark.parametrize(
    ("duration_s", "tick_us", "ticks"),
    [(1.0, 1000, 1000), (0.3, 1000, 300), (0.0006, 1000, 1), (2.5, 2000, 1250),
     (0.0026, 1000, 3), (3600.0, 1000, 3_600_000), (1 / 3, 1000, 333)],
)  # fmt: skip
def test_a_run_is_the_whole_ticks_nearest_to_its_duration(
    duration_s: float, tick_us: int, ticks: int
) -> None:
    assert tick_count(duration_s, tick_us) == ticks


@pytest.mark.parametrize("duration_s", [0.0, -1.0, float("nan"), float("inf"), 2e9])
def test_an_impossible_duration_is_refused(duration_s: float) -> None:
    with pytest.raises(EvsError, match="at duration_s"):
        run(FakeWorld(), [], duration_s)


@pytest.mark.parametrize(("duration_s", "tick_us"), [(1e-9, 1000), (0.0001, 1000), (1.0, 10**9)])
def test_a_run_of_less_than_half_a_tick_is_refused(duration_s: float, tick_us: int) -> None:
    with pytest.raises(EvsError, match=r"at duration_s: .* half a tick"):
        tick_count(duration_s, tick_us)


@pytest.mark.parametrize("tick_us", [0, -1000])
def test_an_impossible_tick_is_refused(tick_us: int) -> None:
    with pytest.raises(EvsError, match=r"at scene\.tick_us"):
        tick_count(1.0, tick_us)


def test_when_the_second_sink_does_not_open_the_first_is_closed() -> None:
    world, diary, kept = FakeWorld(), list[str](), list[Report]()
    sinks = [
        FakeSink("one", diary),
        FakeSink("two", diary, open=EvsError("port in use")),
        FakeSink("three", diary),
    ]
    with pytest.raises(EvsError, match=r"^port in use$"):
        run(world, sinks, 1.0, on_report=kept.append)
    # the one that failed is closed too, the one never reached is left alone
    assert diary == ["one open", "two open", "two close", "one close"]
    assert world.tick == 0
    # the run never began
    assert kept == []


class PhysicsError(EvsError):
    """As physics raises it: a kind of EvsError."""


def test_an_error_of_the_world_closes_every_sink_and_is_raised_as_it_is() -> None:
    diary, kept = list[str](), list[Report]()
    world = FakeWorld(t7=PhysicsError("unstable at 0.007 s"))
    sinks = [FakeSink("one", diary), FakeSink("two", diary)]
    with pytest.raises(PhysicsError, match="unstable"):
        run(world, sinks, 1.0, on_report=kept.append)
    assert [len(sink.packets) for sink in sinks] == [7, 7]
    assert diary[-2:] == ["two close", "one close"]
    assert kept[0].ended == "error at 0.007 s: unstable at 0.007 s"
    assert (kept[0].ticks, kept[0].events, kept[0].sinks[0]["packets"]) == (7, 14, 7)


def test_no_memory_for_the_report_does_not_hide_what_ended_the_run() -> None:
    def exhausted(_: Report) -> None:
        raise MemoryError

    warned = list[str]()
    world = FakeWorld(t7=PhysicsError("unstable at 0.007 s"))
    with pytest.raises(PhysicsError, match="unstable"):
        run(world, [FakeSink("one", [])], 1.0, on_report=exhausted, warn=warned.append)
    assert warned == ["no memory is left for the run report"]
    with pytest.raises(MemoryError):
        run(FakeWorld(), [FakeSink("one", [])], 0.01, on_report=exhausted)


def test_a_full_disk_is_one_line_and_the_other_sinks_are_closed() -> None:
    diary, kept = list[str](), list[Report]()
    sinks = [FakeSink("one", diary), FakeSink("two", diary, write=full_disk())]
    with pytest.raises(EvsError) as caught:
        run(FakeWorld(), sinks, 1.0, on_report=kept.append)
    assert str(caught.value) == "cannot write: '/media/x.aedat4': No space left on device"
    assert diary[-2:] == ["two close", "one close"]
    assert [len(sink.packets) for sink in sinks] == [3, 2]
    assert kept[0].ended.startswith("error at 0.003 s: cannot write")


@pytest.mark.parametrize("error", [full_disk(), EvsError("torn"), ValueError("a bug")])
def test_an_error_while_closing_still_closes_the_others_and_is_raised(error: Exception) -> None:
    diary, kept = list[str](), list[Report]()
    sinks = [FakeSink("one", diary), FakeSink("two", diary, close=error)]
    kind = ValueError if isinstance(error, ValueError) else EvsError
    with pytest.raises(kind):
        run(FakeWorld(), sinks, 0.003, on_report=kept.append)
    assert diary[-2:] == ["two close", "one close"]
    assert kept[0].ended.startswith("error while closing: ")
    assert "error" in kept[0].sinks[1]
    assert kept[0].sinks[0]["packets"] == 3


def test_a_bug_closes_the_sinks_and_keeps_its_type() -> None:
    diary = list[str]()
    with pytest.raises(ZeroDivisionError):
        run(FakeWorld(t2=ZeroDivisionError("bug")), [FakeSink("one", diary)], 1.0)
    assert diary == ["one open", "one close"]


def test_the_first_error_is_the_one_raised() -> None:
    diary = list[str]()
    sinks = [FakeSink("one", diary, close=EvsError("second"))]
    with pytest.raises(EvsError, match=r"^first$"):
        run(FakeWorld(t2=EvsError("first")), sinks, 1.0)


@pytest.mark.parametrize(
    ("number", "word"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")]
)
def test_a_signal_ends_the_run_after_its_tick(number: signal.Signals, word: str) -> None:
    diary, before = list[str](), signal.getsignal(number)
    sink = FakeSink("one", diary)
    report = run(FakeWorld(t4=lambda: signal.raise_signal(number)), [sink], 1.0)
    # the tick in which it came is whole
    assert report.ticks == 5
    assert len(sink.packets) == 5
    assert report.ended == f"{word} at 0.005 s"
    assert diary[-1] == "one close"
    assert signal.getsignal(number) is before


def test_a_signal_in_the_last_tick_changes_nothing() -> None:
    report = run(FakeWorld(t4=lambda: signal.raise_signal(signal.SIGINT)), [], 0.005)
    assert (report.ticks, report.ended) == (5, "complete")


def test_who_insists_is_obeyed_inside_the_tick() -> None:
    def twice() -> None:
        signal.raise_signal(signal.SIGINT)
        # as long as a person takes to press it again
        sleep_s(0.3)
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("still in the tick")

    diary = list[str]()
    report = run(FakeWorld(t4=twice), [FakeSink("one", diary)], 1.0)
    assert (report.ticks, report.ended) == (4, "interrupted at 0.004 s")
    assert diary[-1] == "one close"


def test_ctrl_c_while_a_sink_opens_ends_the_run() -> None:
    diary = list[str]()
    report = run(FakeWorld(), [FakeSink("one", diary, open=KeyboardInterrupt())], 1.0)
    assert (report.ticks, report.ended) == (0, "interrupted at 0 s")
    assert diary == ["one open", "one close"]


def test_ctrl_c_while_a_sink_closes_still_closes_the_others() -> None:
    diary = list[str]()
    sinks = [FakeSink("one", diary), FakeSink("two", diary, close=KeyboardInterrupt())]
    report = run(FakeWorld(), sinks, 0.003)
    assert report.ended == "interrupted at 0.003 s, while closing"
    assert diary[-2:] == ["two close", "one close"]


def test_a_run_in_another_thread_leaves_the_signals_alone() -> None:
    reports: list[Report] = []
    thread = threading.Thread(target=lambda: reports.append(run(FakeWorld(), [], 0.01)))
    thread.start()
    thread.join(10)
    assert reports[0].ticks == 10


def test_a_dark_scene_runs_and_is_warned_of_once_a_camera() -> None:
    lines: list[str] = []
    report = run(FakeWorld(("a", "b"), dark=True), [], 0.01, warn=lines.append)
    assert report.ticks == 10
    assert len(lines) == 2
    assert "'a'" in lines[0]
    assert "render.headlight=model" in lines[0]
    assert report.warnings == lines


def test_packets_leave_at_the_pace_and_waiting_is_nobodys_time() -> None:
    slept: list[float] = []
    now = [0.0]

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now[0] += max(0.0, seconds)

    watch = StopWatch(lambda: now[0])
    report = run(FakeWorld(), [], 0.01, watch, Pacer(1.0, lambda: now[0], sleep))
    assert len(slept) == 10
    assert sum(slept) == pytest.approx(0.01)
    assert all(taken.p99 == 0.0 for taken in report.stage_ms.values())


def test_a_pace_that_cannot_be_held_is_warned_of() -> None:
    now, lines = [0.0], list[str]()

    def slow() -> None:
        now[0] += 0.15

    pacer = Pacer(1.0, lambda: now[0], lambda s: now.__setitem__(0, now[0] + max(0.0, s)))
    report = run(FakeWorld(t3=slow), [], 0.01, pace=pacer, warn=lines.append)
    assert (report.ticks, report.ended) == (10, "complete")
    assert len(lines) == 1
    assert "s late" in lines[0]
    assert report.warnings == lines
    # without a pace nothing can be late
    assert run(FakeWorld(t3=slow), [], 0.01, pace=Pacer()).warnings == []


class PackingSink(FakeSink):
    meter: Meter = NoMeter()

    def write(self, packet: EventPacket) -> None:
        NOW[0] += 0.25
        self.meter.lap("pack")
        NOW[0] += 0.5


NOW = [0.0]


def test_a_sink_may_tell_packing_from_sending() -> None:
    report = run(FakeWorld(), [PackingSink("one", [])], 0.003, StopWatch(lambda: NOW[0]))
    assert report.stage_ms["pack"].median == pytest.approx(250, rel=0.006)
    assert report.stage_ms["sink"].median == pytest.approx(500, rel=0.006)
