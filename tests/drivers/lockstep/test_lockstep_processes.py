"""A closed loop with its controller in another process: the same bytes, and clear ends."""

from __future__ import annotations

import hashlib
import json
import math
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evs
from evs.drivers import files
from evs.drivers.bus.address import free_address
from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.lockstep import RemoteLoop
from evs.emulator.config import SensorConfig
from evs.launch.main import main
from evs.msgs import EvsError, Observation

pytestmark = pytest.mark.integration

SCENE = Path(__file__).parents[3] / "config" / "scenes" / "cartpole.xml"
WIDTH, HEIGHT = 32, 24
CAMERAS = ("watch", "onboard")
WORDS = (
    *("sensor.preset=davis346", f"sensor.width={WIDTH}", f"sensor.height={HEIGHT}", "render.spp=1"),
    *("threads=1", 'lockstep.cameras=["watch", "onboard"]', "seed=5"),
    *("loop.delays.transport_us=1500", "loop.delays.transport_jitter_us=400.0"),
    *("loop.delays.drop_share=0.02", "loop.delays.control_us=1000", "loop.max_s=30.0"),
)


def emulate_words(address: str, *words: str) -> list[str]:
    """`emulate --pace lockstep` on the cart-pole."""
    start = ["emulate", "--scene", str(SCENE), "--pace", "lockstep", f"lockstep.address={address}"]
    return [*start, *WORDS, *words]


@contextmanager
def served(folder: Path, *words: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """`evs emulate --pace lockstep` on the cart-pole; (address, process)."""
    address = f"ipc://{folder}/loop"
    program = [sys.executable, "-m", "evs.launch.main"]
    with subprocess.Popen(
        [*program, *emulate_words(address, *words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield address, process
        finally:
            if process.poll() is None:
                process.kill()


def ended(process: subprocess.Popen[str], number: int = signal.SIGINT) -> tuple[str, str]:
    """Its stdout and stderr after a signal; it ends well."""
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return out, err


class Controller:
    """Pushes the cart towards where the onboard camera sees the pole go; notes all it does."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self.events = 0

    def __call__(self, seen: Observation) -> list[float]:
        offset = 0.0
        for packet in seen.packets:
            self.digest.update(f"{packet.camera} {packet.seq} {packet.time_end_us}".encode())
            self.digest.update(packet.events.tobytes())
            self.events += len(packet)
            if packet.camera == "onboard" and len(packet):
                offset = float(np.mean(packet.events["x"])) - (WIDTH - 1) / 2
        self.digest.update(seen.position.tobytes() + seen.velocity.tobytes())
        force = math.tanh(0.05 * offset - 0.1 * float(seen.position[0]) + 0.3 * math.sin(seen.t_us))
        self.digest.update(np.float64(force).tobytes())
        return [force]


def driven(loop: Any, seconds: float) -> tuple[str, int, Observation]:
    """(digest, events, last) of one episode."""
    controller = Controller()
    seen = loop.reset(seed=11)
    while not seen.done and seen.t_us < 1e6 * seconds:
        seen = loop.step(controller(seen))
    return controller.digest.hexdigest(), controller.events, seen


def in_process(render: evs.RenderConfig) -> evs.ClosedLoop:
    return evs.ClosedLoop(
        str(SCENE),
        cameras=CAMERAS,
        sensor=SensorConfig("davis346", width=WIDTH, height=HEIGHT),
        render=render,
        seed=5,
        threads=1,
        max_s=30.0,
        delays=evs.DelayConfig(
            transport_us=1500, transport_jitter_us=400.0, drop_share=0.02, control_us=1000
        ),
    )


HARD = evs.RenderConfig(spp=1)
CYCLE = evs.RenderConfig(renderer="path", spp=1, seeds="cycle")


@pytest.mark.parametrize(
    ("seconds", "render"),
    [(0.5, HARD), (0.2, CYCLE), pytest.param(30.0, HARD, marks=pytest.mark.campaign)],
    ids=["short", "cycle", "30 s"],
)
def test_over_zeromq_the_loop_gives_the_bytes_that_it_gives_in_process(
    tmp_path: Path, seconds: float, render: evs.RenderConfig
) -> None:
    mine, events, last = driven(in_process(render), seconds)
    assert events > 100 * seconds
    words = [f"render.{key}={getattr(render, key)}" for key in ("renderer", "seeds")]
    with served(tmp_path, *words) as (address, process):
        with evs.connect(address) as loop:
            for _ in range(2 if seconds < 1 else 1):
                theirs, count, end = driven(loop, seconds)
                assert (theirs, count) == (mine, events)
                assert (end.t_us, end.done) == (last.t_us, last.done)
        out, _ = ended(process)
    assert ", 1 controller\n" in out
    if seconds == 30.0:
        assert end.done == "30 s are over"


def test_saved_over_the_wire_it_goes_on_here_and_there_with_the_same_bytes(tmp_path: Path) -> None:
    def go_on(loop: Any) -> str:
        controller = Controller()
        seen = loop.step([0.2])
        for _ in range(60):
            seen = loop.step(controller(seen))
        return controller.digest.hexdigest()

    with served(tmp_path) as (address, process), evs.connect(address) as loop:
        with pytest.raises(EvsError, match="call reset before save"):
            loop.save()
        loop.reset(4)
        loop.step([0.5], 75)
        blob = loop.save()
        small = loop.save(compress=True)
        first = go_on(loop)
        again = loop.restore(blob)
        assert again.t_us == 75_000
        assert go_on(loop) == first
        loop.restore(small)
        assert go_on(loop) == first
        with pytest.raises(EvsError, match="saved"):
            loop.restore(blob[:-9])
        loop.close()
        ended(process)
    assert len(small) < len(blob)
    mine = in_process(HARD)
    assert mine.restore(blob) == again
    assert go_on(mine) == first


def test_sinks_beside_it_get_every_tick_undelayed_and_the_report_counts(tmp_path: Path) -> None:
    run, report = tmp_path / "run.npz", tmp_path / "report.json"
    words = ("lockstep.cameras=[]", "scene.camera=onboard", "--record", str(run))
    ticks = (120, 80)
    recordings = []
    with served(tmp_path, *words, "--report", str(report)) as (address, process):
        with evs.connect(address) as loop:
            for seed, count in enumerate(ticks):
                seen = loop.reset(seed)
                for _ in range(count):
                    seen = loop.step([0.1])
                assert seen.t_us == 1000 * count
        out, err = ended(process)
    assert f'evs.connect("{address}")' in err
    assert "200 steps in 2 episodes" in out
    told = json.loads(report.read_text())
    assert told["loop"]["steps"] == sum(ticks)
    assert told["loop"]["episodes"] == 2
    assert told["loop"]["decision_ms"]["median"] > 0
    assert told["ticks"] == sum(ticks)
    assert told["ended"] == "interrupted at 0.2 s"
    assert (
        told["packets"] == told["loop"]["packets_lost"] + sum(ticks) - told["loop"]["packets_lost"]
    )
    assert told["loop"]["files"] == [str(run), str(tmp_path / "run-episode-002.npz")]
    for place, name in enumerate(told["loop"]["files"]):
        recordings.append(files.read(name))
        assert Path(f"{name}.report.json").is_file()
        world = evs.World(str(SCENE), seed=place, threads=1)
        sensor = SensorConfig("davis346", width=WIDTH, height=HEIGHT)
        world.add_camera("onboard", sensor=sensor, render=evs.RenderConfig(spp=1))
        # the control acts a tick after the decision, nothing else of the delays is in a recording
        mine = [world.step([0.0] if tick == 0 else [0.1]) for tick in range(ticks[place])]
        events = np.concatenate([packet.events["t"] for (packet,) in mine])
        assert recordings[place]["t"].tolist() == events.tolist()
    assert told["events"] == sum(map(len, recordings))


def test_a_bus_beside_it_goes_on_over_resets(tmp_path: Path) -> None:
    bus = free_address()
    with (
        served(tmp_path, "--publish", bus, "--wait-for", "1") as (address, process),
        evs.subscribe(bus, "onboard", timeout_s=20) as stream,
        evs.connect(address) as loop,
    ):
        for seed in range(2):
            loop.reset(seed)
            loop.step([0.0], 50)
        got = [stream.receive(10) for _ in range(100)]
        assert [packet.seq for packet in got if packet is not None] == [*range(50)] * 2
        assert stream.restarts == 1
        loop.close()
        process.send_signal(signal.SIGTERM)
        assert list(stream) == []
        process.communicate(timeout=60)
        assert process.returncode == 0


def test_a_server_that_is_killed_is_an_error_in_time(tmp_path: Path) -> None:
    with served(tmp_path) as (address, process), evs.connect(address, timeout_s=60) as loop:
        loop.reset()
        loop.step([0.0])
        process.kill()
        process.wait(10)
        begin_s = monotonic_s()
        with pytest.raises(EvsError, match=r"the server at ipc://.* has gone"):
            loop.step([0.0])
        assert monotonic_s() - begin_s < 10


def test_a_step_that_takes_minutes_keeps_nobody_from_ending_it(tmp_path: Path) -> None:
    lines: list[str] = []

    def step(loop: RemoteLoop) -> None:
        try:
            loop.step([0.0], 1_000_000)
        except EvsError as error:
            lines.append(str(error))

    record = tmp_path / "run.aedat4"
    with served(tmp_path, "loop.max_s=2000.0", "--record", str(record)) as (address, process):
        loop = evs.connect(address, timeout_s=600)
        loop.reset()
        asking = threading.Thread(target=step, args=(loop,))
        asking.start()
        sleep_s(2.0)
        begin_s = monotonic_s()
        ended(process, signal.SIGTERM)
        assert monotonic_s() - begin_s < 20
        asking.join(20)
        loop.close()
    assert lines == ["the server of the loop has ended"]


CLIENT = """
import sys, evs
loop = evs.connect(sys.argv[1], "second", actuators=())
loop.reset(1)
loop.step()
print("stepped", flush=True)
sys.stdin.read()
"""


def test_a_controller_that_is_killed_is_named_and_the_others_begin_anew(tmp_path: Path) -> None:
    with served(tmp_path, "lockstep.controllers=2") as (address, process):
        first = evs.connect(address, "first", timeout_s=60)
        command = [sys.executable, "-c", CLIENT, address]
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        with subprocess.Popen(command, text=True, **pipes) as second:
            seen = [first.reset(1), first.step([0.5])]
            assert second.stdout is not None
            assert second.stdout.readline() == "stepped\n"
            second.kill()
        with pytest.raises(EvsError, match=r"controller 'second' has gone .* nothing has moved"):
            first.step([0.5])
        with subprocess.Popen(command, text=True, **pipes) as second:
            again = [first.reset(1), first.step([0.5])]
            assert second.stdout is not None
            assert second.stdout.readline() == "stepped\n"
            second.communicate("", timeout=20)
        assert again == seen
        first.close()
        _, err = ended(process)
    assert "evs: warning: controller 'second' has gone (its connection closed)" in err


def joined(address: str) -> str:
    """Why there was no seat; empty: there was one, and it was left again."""
    try:
        evs.connect(address).close()
    except EvsError as error:
        return str(error)
    return ""


def test_a_controller_that_a_person_stops_frees_its_seat(tmp_path: Path) -> None:
    with served(tmp_path) as (address, process):
        for _ in range(3):
            loop: RemoteLoop = evs.connect(address)
            loop.reset()
            # no good-bye: its process would have been killed
            assert loop._end is not None
            loop._end.close()
            loop._end = None
            lines = [joined(address)]
            begin_s = monotonic_s()
            while lines[-1] and monotonic_s() - begin_s < 20:
                sleep_s(0.1)
                lines.append(joined(address))
            # until the closed connection is known for one
            assert all("every seat is taken" in line for line in lines[:-1])
            assert lines[-1] == ""
        _, err = ended(process)
    assert err.count("has gone (its connection closed)") == 3


def test_in_real_time_the_clock_moves_physics_and_nothing_is_missed(tmp_path: Path) -> None:
    report, bus = tmp_path / "report.json", free_address()
    words = ("--pace", "realtime", "realtime.serve=true", "--report", str(report))
    words = (*words, "loop.delays.drop_share=0", "--publish", bus)
    with served(tmp_path, *words) as (address, process):
        with evs.subscribe(bus, "onboard", timeout_s=20) as stream, evs.connect(address) as loop:
            # before it, so that no delay on the way makes simulated time look fast
            begin_s = monotonic_s()
            seen = loop.reset(1)
            got = list(seen.packets)
            while seen.t_us < 600_000:
                seen = loop.step([0.0], 5)
                got += seen.packets
                # a pause of the controller stops nothing
                sleep_s(0.1 if 200_000 < seen.t_us < 300_000 else 0.0)
            wall_s = monotonic_s() - begin_s
            assert stream.receive(20) is not None
            while stream.status is None or stream.status.pace is None:
                assert stream.receive(20) is not None
            assert stream.status.pace.speed == 1.0
        out, _ = ended(process)
    for name in CAMERAS:
        seqs = [packet.seq for packet in got if packet.camera == name]
        assert seqs == list(range(len(seqs)))
        assert len(seqs) > 590
    # never faster than the clock, but for what it may catch up with
    assert wall_s > 0.6 - 0.1 - 0.002
    told = json.loads(report.read_text())
    assert told["pace"]["late_ms"]["p99"] >= told["pace"]["late_ms"]["median"] >= 0
    assert told["pace"]["speed"] == 1.0
    assert told["loop"]["episodes"] == 1
    assert "late " in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["lockstep.address=tcp://0.0.0.0:5570"], "cannot serve a closed loop on"),
        (["--duration", "3"], "at duration_s: a closed loop runs until it is stopped"),
        (['lockstep.cameras=["nowhere"]'], "no camera 'nowhere'; there is: "),
        (["lockstep.controllers=0"], "controllers is 0: give 1 ... 1000"),
        (["scene.camera=watch"], "at scene.camera: 'watch' beside lockstep.cameras"),
        (["--pace", "free"], 'at loop: it is for pace = "lockstep" or realtime.serve'),
    ],
)
def test_what_cannot_be_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    assert main(emulate_words(f"ipc://{tmp_path}/loop", *words)) == 2
    out, err = capfd.readouterr()
    assert says in err
    assert len(err.splitlines()) == 1
    assert out == ""
