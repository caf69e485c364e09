"""The bus over a cable that is pulled: the camera goes on, losses are counted, who waits is told.

The camera is in one network namespace, with keys, subscribers and a recorder are in the other.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.bus.curve_keys import write_keys
from evs.drivers.clock import monotonic_s, sleep_s
from links.camera import Camera
from links.link import Link

pytestmark = pytest.mark.integration

LISTENER = """
import json, sys
from evs.drivers.bus import subscribe
first = None
with subscribe(sys.argv[1], queue=5000, timeout_s=float(sys.argv[3]), server_key=sys.argv[2]) as s:
    for packet in s:
        if first is None:
            first = packet.seq
    print(json.dumps({**s.totals(), "first": first, "connected": s.connected}))
"""
PATIENCE_S = 6
"""after which the programs give up a cut connection, where a test waits for that; evs: 30 s"""
EVENTS = 3000
"""in each packet: 48 kB"""
QUEUE = 500
"""packets that wait for a subscriber; less than is lost while the cable is out"""
SLOWEST_S = 1.0
"""no write takes longer, however busy the machine; one that waited for the cable would"""


class Scene:
    """A camera at the near end, with keys; whoever listens runs at the far end."""

    def __init__(self, link: Link, folder: Path, version: int = 4) -> None:
        self.link, self.folder = link, folder
        self.key, secret = (str(one) for one in write_keys(folder / "camera"))
        host = link.near.address if version == 4 else f"[{link.near.address6}]"
        here = f"tcp://{host}:0"
        self.camera = Camera(
            link.near, "bus", events=EVENTS, address=here, control=here, key=secret, queue=QUEUE
        )

    def listen(self, timeout_s: float) -> subprocess.Popen[str]:
        where = self.camera.where["events"]
        words = ["-c", LISTENER, where, self.key, str(timeout_s)]
        return self.link.far.run([*self.link.far.python, *words], stdout=-1, stderr=-1, text=True)

    def evs(self, command: str, *words: str) -> subprocess.Popen[str]:
        """A command of ours that listens to the camera."""
        line = [*self.link.far.python, "-m", "evs.launch.main", command]
        line += [self.camera.where["events"], *words, "--server-key", self.key]
        return self.link.far.run(line, stdout=-1, stderr=-1, text=True)


@pytest.fixture
def scene(link: Link, tmp_path: Path) -> Scene:
    return Scene(link, tmp_path)


def totals(listener: subprocess.Popen[str]) -> dict[str, Any]:
    out, error = listener.communicate(timeout=60)
    assert (listener.returncode, error) == (0, "")
    said: dict[str, Any] = json.loads(out)
    return said


def recorded(file: Path) -> tuple[list[int], int]:
    """Which packets a recording holds, and how many events: each begins with its stamp."""
    events = files.read(file)
    ticks = (events["t"] - 1) // 1000
    numbers, counts = np.unique(ticks, return_counts=True)
    assert set(counts.tolist()) == {EVENTS}
    return numbers.tolist(), len(events)


@pytest.mark.parametrize("version", [4, pytest.param(6, marks=pytest.mark.slow)])
def test_a_cable_is_out_for_seconds(link: Link, tmp_path: Path, version: int) -> None:
    if version == 6 and not link.near.has_ipv6:
        pytest.skip("this machine has no IPv6")
    scene = Scene(link, tmp_path, version)
    file = tmp_path / "run.aedat4"
    listener, recorder = scene.listen(60), scene.evs("record", str(file))
    scene.camera.wait("here", 2)
    begin = scene.camera.look()["seq"]
    scene.camera.wait("seq", begin + 300)
    # one namespace's card goes off, then the other's; TCP asks again at growing intervals
    link.unplug(link.far if version == 4 else link.near)
    out_at = scene.camera.look()["seq"]
    scene.camera.wait("seq", out_at + 2000)
    link.plug()
    in_at = scene.camera.look()["seq"]
    scene.camera.wait("seq", in_at + 4000)
    report = scene.camera.stop()
    sent = report["seq"]
    assert report["slowest_s"] < SLOWEST_S

    heard = totals(listener)
    assert heard["first"] + heard["packets"] + heard["lost"] == sent
    # what did not wait in its queue or the system's is lost, and not all of what came later
    assert 0 < heard["lost"] < sent - out_at
    assert (heard["restarts"], heard["bad_messages"], heard["ended"]) == (0, 0, True)

    out, error = recorder.communicate(timeout=60)
    assert recorder.returncode == 1
    numbers, events = recorded(file)
    told = json.loads(Path(f"{file}.report.json").read_text())
    assert (told["packets"], told["events"]) == (len(numbers), events)
    # every packet that is not there lies in a gap that is told
    missing = {
        n for gap in told["gaps"] for n in range(gap["begin_us"] // 1000, gap["end_us"] // 1000)
    }
    assert missing == set(range(numbers[0], sent)) - set(numbers)
    assert told["lost"] == len(missing) == sum(gap["packets"] for gap in told["gaps"]) > 0
    assert told["ended"] == "the camera has ended"
    lines = out.splitlines()
    assert lines[0].endswith(f"{len(missing):,} packets lost; the camera has ended")
    assert lines[1].startswith("  lost: ")
    assert len(error.splitlines()) == 1


def test_a_cable_is_out_for_good(scene: Scene) -> None:
    """Who has a time-out says so and ends; the camera goes on in the memory of its queues."""
    file = scene.folder / "run.aedat4"
    listener = scene.listen(2)
    recorder = scene.evs("record", str(file), "--timeout", "2")
    echo = scene.evs("echo", "--quiet", "--timeout", "2")
    scene.camera.wait("here", 3)
    begin = scene.camera.look()
    scene.camera.wait("seq", begin["seq"] + 500)
    scene.link.unplug()
    cut = scene.camera.look()
    heard = totals(listener)
    out, _ = recorder.communicate(timeout=60)
    _, error = echo.communicate(timeout=60)
    assert (echo.returncode, error) == (0, "")
    assert heard["first"] + heard["packets"] <= scene.camera.look()["seq"]
    assert (heard["lost"], heard["ended"]) == (0, False)
    numbers, events = recorded(file)
    assert out.splitlines()[0].endswith(f"{events:,} events, 0 packets lost; nothing came for 2 s")
    assert recorder.returncode == 0
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    # three queues full, and as much for what the allocator keeps; four times as much is sent
    scene.camera.wait("seq", cut["seq"] + 4 * 3 * QUEUE)
    bound_kb = 2 * 3 * QUEUE * 16 * EVENTS / 1024
    assert scene.camera.look()["memory_kb"] - begin["memory_kb"] < bound_kb
    report = scene.camera.stop()
    assert report["slowest_s"] < SLOWEST_S
    # it waited for its subscribers to learn that it ends: 2 s, and a busy machine's time
    assert report["closing_s"] < 20


ASKING = """
import sys
from evs.drivers.bus import Latest, discover
from evs.drivers.clock import sleep_s
from evs.msgs import EvsError
control, key = sys.argv[1:]
where = discover(control, server_key=key).latest
with Latest(where, server_key=key) as latest:
    print(latest.get(30).of("cam").seq, flush=True)
    for line in sys.stdin:
        try:
            discover(control, timeout_s=1, server_key=key)
            while latest.get(0) is not None:
                pass
            print("answered", latest.get(30).of("cam").seq, flush=True)
        except EvsError as reason:
            while latest.get(0) is not None:
                pass
            print("refused", latest.get(1), reason, flush=True)
"""


def test_discovery_and_latest_state_over_a_cable(scene: Scene) -> None:
    """Asked while it is out: one line in time; asked after: the state of now, not of then."""
    words = ["-c", ASKING, scene.camera.where["control"], scene.key]
    command = [*scene.link.far.python, *words]
    asking = scene.link.far.run(command, stdin=-1, stdout=-1, text=True)

    def ask() -> list[str]:
        asking.stdin.write("now\n")
        asking.stdin.flush()
        words: list[str] = asking.stdout.readline().split()
        return words

    assert int(asking.stdout.readline()) >= 0
    assert ask()[0] == "answered"
    scene.link.unplug()
    begin_s = monotonic_s()
    said = ask()
    # one second each for the answer and the state
    assert monotonic_s() - begin_s < 20
    assert said[:2] == ["refused", "None"]
    assert "nobody answers at" in " ".join(said)
    scene.link.plug()
    deadline_s = monotonic_s() + 60
    while (said := ask())[0] != "answered":
        assert monotonic_s() < deadline_s
    before = scene.camera.look()["seq"]
    # what waited in the system's small buffers comes first, then only what is new
    while int(ask()[1]) < before:
        assert monotonic_s() < deadline_s
    assert scene.camera.stop()["slowest_s"] < SLOWEST_S


@pytest.mark.slow
@pytest.mark.parametrize("at", ["far", "near"])
def test_a_cable_is_out_for_so_long_that_the_connection_is_given_up(
    link: Link, tmp_path: Path, at: str
) -> None:
    """The systems of both ends notice, and it is made again by itself."""
    link.give_up_after(PATIENCE_S)
    scene = Scene(link, tmp_path)
    file = scene.folder / "run.aedat4"
    listener, recorder = scene.listen(120), scene.evs("record", str(file))
    scene.camera.wait("here", 2)
    scene.camera.wait("seq", scene.camera.look()["seq"] + 500)
    scene.link.unplug(getattr(scene.link, at))
    # its patience, and up to a sixth of it until the system asks next
    scene.camera.wait("here", 0, 0, patience_s=60)
    sleep_s(6)
    scene.link.plug()
    # an attempt to connect is given up after 5 s and made again
    scene.camera.wait("here", 2, patience_s=30)
    scene.camera.wait("seq", scene.camera.look()["seq"] + 1000)
    report = scene.camera.stop()
    heard = totals(listener)
    assert heard["first"] + heard["packets"] + heard["lost"] == report["seq"]
    assert heard["lost"] > 1000 * PATIENCE_S
    assert heard["ended"]
    _, error = recorder.communicate(timeout=60)
    where = scene.camera.where["events"]
    assert error.splitlines()[1:] == [
        f"evs: warning: the connection to {where} is cut: waiting for it (Ctrl-C ends)",
        f"evs: warning: the connection to {where} is there again",
    ]
    numbers, _ = recorded(file)
    told = json.loads(Path(f"{file}.report.json").read_text())
    assert told["lost"] == report["seq"] - numbers[0] - len(numbers) == told["gaps"][0]["packets"]
    assert report["slowest_s"] < SLOWEST_S
