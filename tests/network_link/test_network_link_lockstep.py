"""Lock-step over a cable that is pulled: no step is lost or done twice, and silence is told.

The loop is served in one network namespace, with keys; its controller is in the other.
"""

from __future__ import annotations

import hashlib
import json
import math
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

import evs
from evs.drivers.bus.curve_keys import write_keys
from evs.drivers.clock import monotonic_s, sleep_s
from evs.emulator.config import SensorConfig
from links.link import Link

pytestmark = pytest.mark.integration

SCENE = Path(__file__).parents[2] / "config" / "scenes" / "cartpole.xml"
WIDTH, HEIGHT = 32, 24
WORDS = (
    *("sensor.preset=dvs128", f"sensor.width={WIDTH}", f"sensor.height={HEIGHT}", "render.spp=1"),
    *("threads=1", "loop.delays.transport_us=1500", "loop.delays.drop_share=0.02"),
)

CONTROLLER = """
import hashlib, json, math, sys
from evs.drivers.lockstep import connect
from evs.msgs import EvsError
address, timeout_s, keys = sys.argv[1], float(sys.argv[2]), json.loads(sys.argv[3])
digest, steps = hashlib.sha256(), 0
try:
    with connect(address, timeout_s=timeout_s, **keys) as loop:
        seen = loop.reset(seed=11)
        print(json.dumps({"t_us": seen.t_us}), flush=True)
        for line in sys.stdin:
            count, ticks = map(int, line.split())
            print(json.dumps({"asks": count}), flush=True)
            for _ in range(count):
                seen = loop.step([math.sin(0.01 * steps)], ticks)
                steps += 1
                for packet in seen.packets:
                    digest.update(f"{packet.seq} {packet.time_end_us}".encode())
                    digest.update(packet.events.tobytes())
                digest.update(seen.position.tobytes() + seen.velocity.tobytes())
            print(json.dumps({"t_us": seen.t_us, "digest": digest.hexdigest()}), flush=True)
except EvsError as error:
    print(json.dumps({"error": str(error)}), flush=True)
"""


class Scene:
    """A served loop at the near end; controllers run at the far end."""

    def __init__(self, link: Link, folder: Path) -> None:
        self.link, self.report = link, folder / "report.json"
        self.key, secret = (str(one) for one in write_keys(folder / "loop"))
        command = [*link.near.python, "-m", "evs.launch.main", "emulate"]
        command += ["--scene", str(SCENE), "--pace", "lockstep", *WORDS, f"report={self.report}"]
        command += [f"lockstep.address=tcp://{link.near.address}:0", f"lockstep.key={secret}"]
        self.world = link.near.run(command, stdout=-1, stderr=-1, text=True)
        line = self.world.stderr.readline()
        assert "waits for evs.connect" in line
        self.address = line.split('"')[1]

    def controller(self, timeout_s: float = 60, **keys: str) -> Controller:
        """One that has the server's key, unless others are given."""
        return Controller(self, timeout_s, keys or {"server_key": self.key})

    def end(self) -> dict[str, Any]:
        """The report's account of the loop."""
        self.world.send_signal(signal.SIGINT)
        _, error = self.world.communicate(timeout=60)
        assert self.world.returncode == 0, error
        told: dict[str, Any] = json.loads(self.report.read_text())["loop"]
        return told


class Controller:
    """A process at the far end that takes steps when it is told."""

    def __init__(self, scene: Scene, timeout_s: float, keys: dict[str, str]) -> None:
        words = [scene.address, str(timeout_s), json.dumps(keys)]
        command = [*scene.link.far.python, "-c", CONTROLLER, *words]
        self.program: subprocess.Popen[str] = scene.link.far.run(
            command, stdin=-1, stdout=-1, text=True
        )

    def told(self) -> dict[str, Any]:
        """The next line that it says."""
        assert self.program.stdout is not None
        found: dict[str, Any] = json.loads(self.program.stdout.readline())
        return found

    def ask(self, count: int, ticks: int = 1) -> None:
        """Let it begin with so many steps."""
        assert self.program.stdin is not None
        self.program.stdin.write(f"{count} {ticks}\n")
        self.program.stdin.flush()
        assert self.told() == {"asks": count}

    def leave(self) -> None:
        """Its end is a good-bye."""
        self.program.communicate(timeout=60)
        assert self.program.returncode == 0


def in_process(*steps: tuple[int, int]) -> dict[str, Any]:
    """Return what the same steps give without any network.

    Args:
        *steps: (count, ticks) of each run of steps: how many, and how many ticks each one takes.
    """
    sensor = SensorConfig("dvs128", width=WIDTH, height=HEIGHT)
    delays = evs.DelayConfig(transport_us=1500, drop_share=0.02)
    render = evs.RenderConfig(spp=1)
    loop = evs.ClosedLoop(str(SCENE), sensor=sensor, render=render, threads=1, delays=delays)
    digest, seen, number = hashlib.sha256(), loop.reset(seed=11), 0
    for count, ticks in steps:
        for _ in range(count):
            seen = loop.step([math.sin(0.01 * number)], ticks)
            number += 1
            for packet in seen.packets:
                digest.update(f"{packet.seq} {packet.time_end_us}".encode())
                digest.update(packet.events.tobytes())
            digest.update(seen.position.tobytes() + seen.velocity.tobytes())
    return {"t_us": seen.t_us, "digest": digest.hexdigest()}


@pytest.fixture
def scene(link: Link, tmp_path: Path) -> Scene:
    return Scene(link, tmp_path)


def test_a_cable_is_out_during_steps(scene: Scene) -> None:
    """Pulled under a request, under a long step, and from either end: the bytes are the same."""
    controller = scene.controller()
    assert controller.told() == {"t_us": 0}
    controller.ask(100)
    controller.told()
    # the request does not arrive; it is sent again twice meanwhile
    scene.link.unplug()
    controller.ask(100)
    sleep_s(3.5)
    scene.link.plug()
    controller.told()
    # the request has arrived, and the answer does not
    controller.ask(1, 2000)
    sleep_s(0.1)
    scene.link.unplug(scene.link.near)
    sleep_s(3.5)
    scene.link.plug()
    controller.told()
    # and in the midst of quick ones
    controller.ask(3000)
    sleep_s(0.2)
    scene.link.unplug()
    sleep_s(1.5)
    scene.link.plug()
    said = controller.told()
    controller.leave()
    assert said == in_process((100, 1), (100, 1), (1, 2000), (3000, 1))
    told = scene.end()
    assert (told["steps"], told["episodes"], told["controllers_lost"]) == (3201, 1, 0)
    assert told["repeated"] >= 1


def test_a_cable_is_out_for_longer_than_anybody_waits(scene: Scene) -> None:
    controller = scene.controller(timeout_s=3)
    controller.told()
    controller.ask(50)
    controller.told()
    scene.link.unplug()
    begin_s = monotonic_s()
    controller.ask(1)
    said = controller.told()
    assert monotonic_s() - begin_s < 20
    address = scene.address
    assert said["error"].startswith(f"no answer from {address} within 3 s: it is busy, waits for")
    controller.leave()
    # who comes while it is out is told, too
    late = scene.controller(timeout_s=1)
    assert late.told()["error"].startswith(f"nobody serves a closed loop at {address} (waited 1 s)")
    late.leave()
    scene.link.plug()
    # its seat is free once the connection is known to be closed: another one goes on
    deadline_s = monotonic_s() + 60
    while "error" in (said := (again := scene.controller(timeout_s=5)).told()):
        assert "no seat" in said["error"] or "nobody serves" in said["error"]
        assert monotonic_s() < deadline_s
        sleep_s(0.5)
    again.ask(50)
    assert again.told() == in_process((50, 1))
    again.leave()
    assert scene.end()["episodes"] == 2


@pytest.mark.slow
def test_a_cable_is_out_for_so_long_that_the_connection_is_given_up(
    link: Link, tmp_path: Path
) -> None:
    """The systems of both ends notice; the controller is told, and another one may come."""
    link.give_up_after(6)
    scene = Scene(link, tmp_path)
    controller = scene.controller(timeout_s=300)
    controller.told()
    controller.ask(50)
    controller.told()
    scene.link.unplug()
    controller.ask(1)
    # its patience, and up to a sixth of it until the system asks next
    begin_s = monotonic_s()
    assert controller.told() == {"error": f"the server at {scene.address} has gone"}
    assert monotonic_s() - begin_s < 60
    controller.leave()
    sleep_s(6)
    scene.link.plug()
    again = scene.controller()
    assert again.told() == {"t_us": 0}
    again.ask(50)
    assert again.told() == in_process((50, 1))
    again.leave()
    told = scene.end()
    assert (told["controllers_lost"], told["episodes"]) == (1, 2)


def test_who_has_other_keys_is_not_let_in(scene: Scene, tmp_path: Path) -> None:
    other, secret = (str(one) for one in write_keys(tmp_path / "other"))
    for keys in ({"server_key": other}, {"server_key": other, "key": secret}):
        said = scene.controller(timeout_s=20, **keys).told()
        assert said["error"].startswith(f"the program at {scene.address} does not let us in: serv")
    said = scene.controller(timeout_s=20, server_key="").told()
    assert "it wants keys (give server_key, its public key)" in said["error"]
    controller = scene.controller()
    assert controller.told() == {"t_us": 0}
    controller.leave()
    assert scene.end()["controllers"] == 1
