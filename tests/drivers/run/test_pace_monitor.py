"""Real-time mode with a clock of our own: what is caught up with, what slips, who hears of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from threading import Thread

import pytest

from evs.drivers.bus import Publisher, subscribe
from evs.drivers.clock import Pacer
from evs.drivers.run import config as pipeline
from evs.drivers.run.config import PIPELINES
from evs.drivers.run.pace_monitor import PaceMonitor
from evs.drivers.run.run import run
from evs.emulator import World
from evs.msgs import EvsError, Pace, Status, StreamInfo, decode_status, encode_status
from evs.msgs.packet import packb, unpackb

TICK_S = 0.001


class Clock:
    """A wall clock that goes when it is slept on, or told to."""

    def __init__(self) -> None:
        self.now_s = 50.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += max(0.0, seconds)


def ticking(
    clock: Clock, pacer: Pacer, costs_s: Callable[[int], float], ticks: int
) -> list[tuple[float, float]]:
    """(wall s, late s) at each tick's end; a tick costs so much."""
    found = []
    begin_s = clock.now_s
    pacer.start(0)
    for tick in range(1, ticks + 1):
        clock.now_s += costs_s(tick)
        pacer.wait_until(1000 * tick)
        found.append((clock.now_s - begin_s, pacer.late_s))
    return found


def test_a_hiccup_below_catch_up_s_leaves_no_trace() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.1)
    times = ticking(clock, pacer, lambda tick: 0.08 if tick == 100 else 0.0, 1000)
    assert times[-1][0] == pytest.approx(1.0)
    assert (pacer.slips, pacer.slipped_s) == (0, 0.0)
    assert pacer.worst_late_s == pytest.approx(0.079)
    # 79 ms late, and one less in each tick after it
    assert sum(late > 1e-9 for _, late in times) == 79
    assert pacer.report()["late_ms"]["worst"] == pytest.approx(79, abs=1e-3)


def test_a_long_pause_slips_by_what_is_beyond_and_races_for_no_more_than_that() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.02)
    times = ticking(clock, pacer, lambda tick: 5.0 if tick == 100 else 0.0, 1000)
    assert pacer.slips == 1
    assert pacer.slipped_s == pytest.approx(5.0 - TICK_S - 0.02)
    assert times[-1][0] == pytest.approx(1.0 + pacer.slipped_s)
    walls = [wall for wall, _ in times]
    # ticks closer than a tick after the pause: 20 ms of them, and never again
    fast = [k for k in range(100, 1000) if walls[k] - walls[k - 1] < 0.5 * TICK_S]
    assert len(fast) == 20
    assert fast[-1] < 125


def test_without_catching_up_no_tick_is_ever_shorter_than_real_time() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.0)
    times = ticking(clock, pacer, lambda tick: 0.003 if tick % 7 == 0 else 0.0004, 700)
    walls = [wall for wall, _ in times]
    assert min(b - a for a, b in pairwise(walls)) > TICK_S - 1e-9
    assert pacer.slips == 100
    assert pacer.slipped_s == pytest.approx(100 * 0.002)
    assert walls[-1] == pytest.approx(0.7 + pacer.slipped_s)


def test_a_machine_that_is_too_slow_slows_simulated_time_and_lateness_is_bounded() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.05)
    times = ticking(clock, pacer, lambda _: 0.002, 2000)
    # every tick is there, at half the speed, and late by at most what is caught up with
    # (what the first takes too long is preparation)
    assert times[-1][0] == pytest.approx(4.0)
    assert pacer.slipped_s == pytest.approx(4.0 - 2.0 - 0.05 - TICK_S)
    assert max(late for _, late in times) == pytest.approx(0.051)
    said = pacer.report()
    assert said["late_ms"]["median"] == pytest.approx(51, rel=0.01)
    assert said["slipped_s"] == pytest.approx(1.949)


def test_half_speed_slips_in_seconds_of_the_wall_clock() -> None:
    clock = Clock()
    pacer = Pacer(0.5, clock, clock.sleep, catch_up_s=0.0)
    times = ticking(clock, pacer, lambda tick: 0.012 if tick == 5 else 0.0, 10)
    assert pacer.slipped_s == pytest.approx(0.010)
    assert times[-1][0] == pytest.approx(0.030)


@pytest.mark.parametrize("catch_up_s", [-0.1, float("nan")])
def test_an_impossible_catch_up_is_refused(catch_up_s: float) -> None:
    with pytest.raises(EvsError, match="catch_up_s is"):
        Pacer(1.0, catch_up_s=catch_up_s)


def test_slipping_is_warned_of_at_once_and_then_ever_more_seldom() -> None:
    clock, lines = Clock(), list[str]()
    pacer = Pacer(1.0, clock, clock.sleep, catch_up_s=0.01)
    monitor = PaceMonitor(pacer, lines.append)
    warned_s = []
    pacer.start(0)
    for tick in range(1, 100_001):
        clock.now_s += 0.002
        pacer.wait_until(1000 * tick)
        before = len(lines)
        monitor.update()
        warned_s += [clock.now_s - 50.0] * (len(lines) - before)
    # 200 s of the wall clock: at once, 10 s later, then 20, 40, 80
    assert warned_s == pytest.approx([0.024, 10.024, 30.024, 70.024, 150.024], abs=0.01)
    monitor.end()
    assert len(lines) == 6
    assert "cannot keep up" in lines[0]
    assert "slipped 100 s behind the wall clock" in lines[-1]
    assert all("\n" not in line for line in lines)


def test_who_keeps_up_hears_nothing() -> None:
    clock, lines = Clock(), list[str]()
    pacer = Pacer(1.0, clock, clock.sleep)
    monitor = PaceMonitor(pacer, lines.append)
    ticking(clock, pacer, lambda _: 0.0009, 100)
    monitor.update()
    monitor.end()
    assert lines == []


def test_statuses_tell_the_pace_ten_times_a_second() -> None:
    clock = Clock()
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
    clock = Clock()
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
