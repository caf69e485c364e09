"""A run that cannot keep its pace: warnings, statuses and the report."""

from __future__ import annotations

from dataclasses import replace
from threading import Thread

import pytest
from manual_clock import ManualClock

from evs.drivers.bus import Publisher, subscribe
from evs.drivers.clock import Pacer
from evs.drivers.run import config as pipeline
from evs.drivers.run.config import PIPELINES
from evs.drivers.run.pace_monitor import PaceMonitor
from evs.drivers.run.run import run
from evs.emulator import World
from evs.msgs import EvsError, Pace, Status, StreamInfo, decode_status, encode_status
from evs.msgs.packet import packb, unpackb


def test_slipping_is_warned_of_at_once_and_then_ever_more_seldom() -> None:
    clock, lines = ManualClock(), list[str]()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.01)
    monitor = PaceMonitor(pacer, lines.append)
    warned_s = []
    pacer.start(0)
    for tick in range(1, 100_001):
        clock.now_s += 0.002
        pacer.wait_until(1000 * tick)
        before = len(lines)
        monitor.update()
        warned_s += [clock.now_s - 100.0] * (len(lines) - before)
    # 200 s of the wall clock: at once, 10 s later, then 20, 40, 80
    assert warned_s == pytest.approx([0.024, 10.024, 30.024, 70.024, 150.024], abs=0.01)
    monitor.end()
    assert len(lines) == 6
    assert "cannot keep up" in lines[0]
    assert "slipped 100 s behind the wall clock" in lines[-1]
    assert all("\n" not in line for line in lines)


def test_who_keeps_up_hears_nothing() -> None:
    clock, lines = ManualClock(), list[str]()
    pacer = Pacer(1.0, clock, clock.sleep)
    monitor = PaceMonitor(pacer, lines.append)
    pacer.start(0)
    for tick in range(1, 101):
        clock.now_s += 0.0009
        pacer.wait_until(1000 * tick)
    monitor.update()
    monitor.end()
    assert lines == []


def test_statuses_tell_the_pace_ten_times_a_second() -> None:
    clock = ManualClock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.01)
    monitor = PaceMonitor(pacer, lambda _: None)
    told = []
    pacer.start(0)
    for tick in range(1, 1001):
        clock.now_s += 0.031 if tick == 500 else 0.0
        pacer.wait_until(1000 * tick)
        told.append(monitor.pace_update(1000 * tick))
    found = [pace for pace in told if pace is not None]
    assert len(found) == 10
    assert found[0] == Pace(1.0, 0, 0, 0, 0)
    assert found[-1] == Pace(1.0, 0, 30_000, 20_000, 1)
    assert PaceMonitor(Pacer(), lambda _: None).pace_update(100_000) is None


STATUS = Status("cam", 1, 2, 3, 4, False, 8, 6, "ideal", 1000, 0, ("cam",))


@pytest.mark.parametrize("pace", [None, Pace(1.0, 5, 70, 900, 2), Pace(0.25, 0, 0, 0, 0)])
def test_a_status_travels_with_the_pace_and_without(pace: Pace | None) -> None:
    status = replace(STATUS, pace=pace)
    header = encode_status(status)
    assert decode_status(header) == status
    assert ("pace" in unpackb(header)) == (pace is not None)


@pytest.mark.parametrize(
    "pace",
    [
        7,
        {},
        {"speed": 1.0},
        {"speed": 0.0, "late_us": 0, "worst_late_us": 0, "slipped_us": 0, "slips": 0},
        {"speed": True, "late_us": 0, "worst_late_us": 0, "slipped_us": 0, "slips": 0},
        {"speed": 1.0, "late_us": -1, "worst_late_us": 0, "slipped_us": 0, "slips": 0},
    ],
)
def test_a_pace_that_is_none_is_refused(pace: object) -> None:
    fields = unpackb(encode_status(STATUS))
    with pytest.raises(EvsError):
        decode_status(packb({**fields, "pace": pace}))


def test_a_run_publishes_its_lateness_and_reports_it() -> None:
    world = World(str(PIPELINES.parent / "scenes" / "pendulum.xml"))
    world.add_camera(sensor="ideal", name="cam")
    clock = ManualClock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.005)
    lines: list[str] = []

    def observe(tick: int, _: object, __: object) -> None:
        clock.now_s += 0.050 if tick == 100 else 0.0

    heard: list[Status] = []

    class Heard(Publisher):
        def close(self) -> dict[str, object]:
            heard.extend(self._audience.statuses(end=False))
            return super().close()

    publisher = Heard("tcp://127.0.0.1:0", linger_s=0.0)
    report = run(world, [publisher], 0.3, pace=pacer, observers=[observe], warn=lines.append)
    assert report.ticks == 300
    # 49 ms late at tick 101, of which 5 are caught up with
    assert report.pace["slipped_s"] == pytest.approx(0.044)
    assert report.pace["slips"] == 1
    assert report.pace["late_ms"]["worst"] == pytest.approx(49, abs=1e-3)
    assert heard[0].pace == Pace(1.0, 0, 49_000, 44_000, 1)
    assert len(lines) == 1
    assert report.warnings == lines
    assert run(world, [], 0.01).pace == {}


def test_a_subscriber_hears_it() -> None:
    publisher = Publisher("tcp://127.0.0.1:0", linger_s=1.0)
    publisher.open([StreamInfo(8, 6, "cam")])
    with subscribe(publisher.address, timeout_s=5) as stream:
        while publisher.subscribers == 0:
            publisher._ports.poll(10)
            publisher._read_requests(publisher._socket)  # type: ignore[arg-type]
        publisher.write_pace(Pace(1.0, 1, 2, 3, 4))
        closing = Thread(target=publisher.close)
        closing.start()
        assert list(stream) == []
        closing.join(10)
        assert stream.status is not None
        assert stream.status.pace == Pace(1.0, 1, 2, 3, 4)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ([("realtime.catch_up_s", "1")], 'at realtime: it is for pace = "realtime" only'),
        ([("pace", "realtime"), ("realtime.catch_up_s", "-1")], "at realtime.catch_up_s: -1.0 s"),
        ([("pace", "reltime")], "at pace: no pace 'reltime'; there is: realtime, "),
    ],
)
def test_bad_keys(keys: list[tuple[str, str]], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        pipeline.load(overrides=[("scene.file", "x.xml"), *keys])
