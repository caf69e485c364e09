"""Subscribers that are killed, come again, or stop reading: the camera and the others go on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from evs.drivers.bus import Latest, Publisher
from evs.drivers.clock import Pacer, monotonic_s
from evs.msgs import EventPacket, StreamInfo, make_events

pytestmark = pytest.mark.integration

LISTENER = """
import json, sys
from evs.drivers.bus import subscribe
first = None
with subscribe(sys.argv[1], queue=int(sys.argv[2]), timeout_s=30) as stream:
    for packet in stream:
        if first is None:
            first = packet.seq
            print("first", flush=True)
    print(json.dumps({**stream.totals(), "first": first}), flush=True)
"""
ANY = "tcp://127.0.0.1:0"
SLOWEST_S = 1.0
"""no write takes longer, however busy the machine; one that waited would wait for ever"""


class Camera:
    """A publisher of packets of 48 kB, a thousand a second, and how long its slowest write took."""

    def __init__(self) -> None:
        self.sender = Publisher(ANY, control=ANY, queue=800, linger_s=5)
        self.sender.open([StreamInfo(346, 260, "cam")])
        stamps = np.sort(np.random.default_rng(0).integers(1, 1001, 3000))
        self.body = make_events(stamps, stamps % 346, stamps % 260, stamps % 2)
        self.pacer, self.seq, self.slowest_s = Pacer(1.0), 0, 0.0

    def send(self, count: int) -> None:
        for _ in range(count):
            self.pacer.wait_until(1000 * self.seq)
            events = self.body.copy()
            events["t"] += 1000 * self.seq
            base_us = 1000 * self.seq
            begin_s = monotonic_s()
            self.sender.write(
                EventPacket(self.seq, base_us, base_us + 1000, 346, 260, events, "cam")
            )
            self.slowest_s = max(self.slowest_s, monotonic_s() - begin_s)
            self.seq += 1

    def send_until(self, subscribers: int) -> None:
        deadline_s = monotonic_s() + 30
        while self.sender.subscribers != subscribers:
            self.send(20)
            assert monotonic_s() < deadline_s


Listeners = list["subprocess.Popen[str]"]


@pytest.fixture
def listeners() -> Iterator[Listeners]:
    started: Listeners = []
    yield started
    for one in started:
        one.send_signal(signal.SIGCONT)
        one.kill()
        one.communicate()


@pytest.fixture
def camera() -> Iterator[Camera]:
    one = Camera()
    yield one
    one.sender.close()


def start(listeners: Listeners, camera: Camera, queue: int = 5000) -> subprocess.Popen[str]:
    command = [sys.executable, "-W", "error", "-c", LISTENER, camera.sender.address, str(queue)]
    listeners.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
    return listeners[-1]


def totals(listener: subprocess.Popen[str]) -> dict[str, int]:
    out, _ = listener.communicate(timeout=60)
    assert listener.returncode == 0
    said: dict[str, int] = json.loads(out.splitlines()[-1])
    return said


def test_killed_and_restarted_subscribers_are_nobody_elses_matter(
    camera: Camera, listeners: Listeners
) -> None:
    well = start(listeners, camera)
    camera.send_until(subscribers=1)
    for _ in range(4):
        other = start(listeners, camera)
        camera.send_until(subscribers=2)
        camera.send(50)
        os.kill(other.pid, signal.SIGKILL)
        camera.send_until(subscribers=1)
    last = start(listeners, camera)
    camera.send_until(subscribers=2)
    camera.send(100)
    sent = camera.seq
    camera.sender.close()
    for listener in (well, last):
        found = totals(listener)
        # everything since it came, which for the last was late
        assert found["first"] + found["packets"] == sent
        assert (found["lost"], found["restarts"], found["bad_messages"]) == (0, 0, 0)
        assert found["ended"]
    assert camera.slowest_s < SLOWEST_S


def test_a_frozen_subscriber_loses_its_own_data_only(camera: Camera, listeners: Listeners) -> None:
    """SIGSTOP: neither it nor its ZeroMQ reads. Kernel and queue fill; later packets are lost."""
    well, frozen = start(listeners, camera), start(listeners, camera)
    camera.send_until(subscribers=2)
    with Latest(discover_latest(camera)) as latest:
        os.kill(frozen.pid, signal.SIGSTOP)
        # 48 kB each: the queue of 800 and what the kernel takes are little more than half of these
        camera.send(1800)
        os.kill(frozen.pid, signal.SIGCONT)
        camera.send(300)
        newest = None
        while newest is None or newest.of("cam").seq < camera.seq - 1:
            camera.send(1)
            newest = latest.get(10)
            assert newest is not None
    sent = camera.seq
    camera.sender.close()
    found_well, found_frozen = totals(well), totals(frozen)
    assert found_well["first"] + found_well["packets"] == sent
    assert found_well["lost"] == 0
    assert found_frozen["lost"] > 0
    assert found_frozen["first"] + found_frozen["packets"] + found_frozen["lost"] == sent
    assert found_frozen["ended"]
    assert camera.slowest_s < SLOWEST_S


def discover_latest(camera: Camera) -> str:
    """The control port is answered between two packets, so it is asked in a process of its own."""
    script = "import sys; from evs.drivers.bus import discover; print(discover(sys.argv[1]).latest)"
    command = [sys.executable, "-c", script, camera.sender.control_address]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as asking:
        while asking.poll() is None:
            camera.send(10)
        assert asking.stdout is not None
        return asking.stdout.read().strip()


def test_a_client_that_leaves_in_the_middle_of_a_request(camera: Camera) -> None:
    """Many ask and are gone before the answer: nothing is kept of them, others are answered."""
    script = (
        "import sys, os, zmq\n"
        "s = zmq.Context().socket(zmq.REQ); s.connect(sys.argv[1]); s.send(b'\\x81'); s.poll(200)\n"
        "os._exit(0)"
    )
    command = [sys.executable, "-c", script, camera.sender.control_address]
    asking = [subprocess.Popen(command) for _ in range(5)]
    while any(one.poll() is None for one in asking):
        camera.send(10)
    answered = discover_latest(camera)
    assert answered == camera.sender.latest_address
    assert camera.slowest_s < SLOWEST_S
