"""The bus between real processes: nothing altered, nothing lost uncounted, nobody in the way."""

import hashlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from evs.drivers.bus import Publisher, subscribe
from evs.drivers.clock import Pacer, monotonic_s, sleep_s
from evs.msgs import EventPacket, StreamInfo
from reference.streams import random_packet

pytestmark = pytest.mark.integration

Opened = Callable[..., Publisher]
STREAM = StreamInfo(346, 260, "cam")

LISTENER = """
import hashlib, json, sys
from evs.drivers.bus import subscribe
from evs.drivers.clock import sleep_s
address, queue, pause_s, hold_after = sys.argv[1:5]
seqs, digest = [], hashlib.sha256()
with subscribe(address, queue=int(queue), timeout_s=30) as stream:
    for packet in stream:
        seqs.append(packet.seq)
        head = (packet.seq, packet.time_base_us, packet.time_end_us, packet.width, packet.height)
        digest.update(repr((*head, packet.camera)).encode() + packet.events.tobytes())
        if len(seqs) == 1:
            print("first", flush=True)
        sleep_s(float(pause_s))
        if len(seqs) == int(hold_after):
            sys.stdin.readline()
    print(json.dumps({**stream.totals(), "seqs": seqs, "digest": digest.hexdigest()}), flush=True)
"""

SENDER = """
import sys
from evs.drivers.bus import Publisher
from evs.msgs import EventPacket, StreamInfo
sender = Publisher(sys.argv[1], wait_for=1)
sender.open([StreamInfo(346, 260, "cam")])
for seq in range(int(sys.argv[2])):
    sender.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, camera="cam"))
if sys.argv[3] == "hang":
    sys.stdin.readline()
sender.close()
"""


def made(seq: int, events: int) -> EventPacket:
    return random_packet(seq, events, camera="cam")


def moved(body: EventPacket, seq: int) -> EventPacket:
    """The same events in another tick."""
    events = body.events.copy()
    events["t"] += 1000 * seq
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, events, "cam")


def digest(packets: list[EventPacket]) -> str:
    total = hashlib.sha256()
    for one in packets:
        head = (one.seq, one.time_base_us, one.time_end_us, one.width, one.height, one.camera)
        total.update(repr(head).encode() + one.events.tobytes())
    return total.hexdigest()


@dataclass
class Processes:
    """Processes of a test; whatever is still there at its end is killed."""

    running: list[subprocess.Popen[str]] = field(default_factory=list)

    def start(self, script: str, *arguments: object) -> subprocess.Popen[str]:
        command = [sys.executable, "-W", "error", "-c", script, *map(str, arguments)]
        pipe = subprocess.PIPE
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        self.running.append(process)
        return process

    def listener(
        self, address: str, queue: int = 1000, pause_s: float = 0.0, hold_after: int = -1
    ) -> subprocess.Popen[str]:
        return self.start(LISTENER, address, queue, pause_s, hold_after)


def result(listener: subprocess.Popen[str]) -> dict[str, Any]:
    """What a listener says at its end; a held one goes on first."""
    out, _ = listener.communicate("\n", timeout=60)
    assert listener.returncode == 0
    totals: dict[str, Any] = json.loads(out.splitlines()[-1])
    return totals


@pytest.fixture
def processes() -> Iterator[Processes]:
    started = Processes()
    yield started
    for process in started.running:
        with suppress(ProcessLookupError):
            process.kill()
        process.communicate()


@pytest.fixture
def opened(processes: Processes) -> Iterator[Opened]:
    """Opens a publisher that waits for so many listeners; closed after a failure, too."""
    senders = []

    def open_one(address: str, listeners: int, **options: Any) -> Publisher:
        sender = Publisher(address, wait_for=listeners, wait_s=60, **options)
        senders.append(sender)
        sender.open([STREAM])
        return sender

    yield open_one
    for sender in senders:
        sender.close()


def eventually(true: Callable[[], bool]) -> None:
    deadline_s = monotonic_s() + 30
    while not true():
        assert monotonic_s() < deadline_s
        sleep_s(0.01)


def test_every_bit_arrives(address: str, processes: Processes, opened: Opened) -> None:
    # empty ones, one event, and frames over 64 kB, where ZeroMQ and pyzmq take other ways
    sizes = [0, 1, 2, 300, 5000, 40_000] * 5
    sent = [made(seq, size) for seq, size in enumerate(sizes)]
    listener = processes.listener(address)
    sender = opened(address, 1)
    for one in sent:
        sender.write(one)
    report = sender.close()
    totals = result(listener)
    assert totals["digest"] == digest(sent)
    assert totals["seqs"] == list(range(len(sent)))
    assert totals["events"] == report["events_sent"] == sum(sizes)
    assert totals["bytes"] == 16 * sum(sizes)
    assert (totals["lost"], totals["bad_messages"], totals["ended"]) == (0, 0, True)
    assert report["packets_sent"] == len(sent)
    assert totals["status"]["events"] == sum(sizes)


def test_nothing_is_lost_at_a_thousand_packets_a_second(
    address: str, processes: Processes, opened: Opened
) -> None:
    sent = [made(seq, 300) for seq in range(2000)]
    listener = processes.listener(address)
    sender = opened(address, 1)
    pacer = Pacer(1.0)
    for one in sent:
        pacer.wait_until(one.time_end_us)
        sender.write(one)
    report = sender.close()
    totals = result(listener)
    assert (totals["packets"], totals["lost"], totals["ended"]) == (2000, 0, True)
    assert (report["packets_sent"], report["packets_unsubscribed"]) == (2000, 0)
    assert totals["digest"] == digest(sent)


def test_the_loss_of_the_last_packets_is_counted(
    address: str, processes: Processes, opened: Opened
) -> None:
    """A subscriber stops after its first packet; every queue on the way fills; then it goes on."""
    count = 400
    listener = processes.listener(address, queue=2, hold_after=1)
    sender = opened(address, 1, queue=2, linger_s=0.3)
    # 320 kB each: 128 MB in all, far more than the kernel takes
    body = made(0, 20_000)
    for seq in range(count):
        sender.write(moved(body, seq))
    begin_s = monotonic_s()
    report = sender.close()
    # it waited for the listener as long as it may, and no longer
    assert 0.3 <= monotonic_s() - begin_s < 10
    assert report["packets_sent"] == count
    totals = result(listener)
    assert totals["ended"]
    assert totals["seqs"][-1] < count - 1
    assert totals["lost"] > 0
    assert totals["packets"] + totals["lost"] == count
    assert totals["status"]["packets"] == count
    assert (totals["restarts"], totals["bad_messages"]) == (0, 0)


def test_a_slow_subscriber_counts_all_that_it_loses(
    address: str, processes: Processes, opened: Opened
) -> None:
    """It never stops reading, so it loses some in the middle and learns of the end in time."""
    count = 500
    listener = processes.listener(address, queue=1, pause_s=0.004)
    sender = opened(address, 1, queue=1, linger_s=20)
    body = made(0, 20_000)
    for seq in range(count):
        sender.write(moved(body, seq))
    sender.close()
    totals = result(listener)
    assert totals["ended"]
    assert totals["lost"] > 0
    assert totals["packets"] + totals["lost"] == count
    assert totals["packets"] == len(totals["seqs"])
    assert max(np.diff(totals["seqs"])) > 1
    assert min(np.diff(totals["seqs"])) == 1


def test_one_that_stops_reading_harms_no_other(
    address: str, processes: Processes, opened: Opened
) -> None:
    count = 1200
    stuck = processes.listener(address, queue=2, hold_after=1)
    well = processes.listener(address)
    # 48 kB each: 500 of them and what the kernel takes are a good half of all
    sender = opened(address, 2, queue=500, linger_s=0.3)
    body = made(0, 3000)
    pacer, slowest_s = Pacer(1.0), 0.0
    for seq in range(count):
        pacer.wait_until(1000 * seq)
        begin_s = monotonic_s()
        sender.write(moved(body, seq))
        slowest_s = max(slowest_s, monotonic_s() - begin_s)
    sender.close()
    totals = result(well)
    assert (totals["packets"], totals["lost"], totals["ended"]) == (count, 0, True)
    totals = result(stuck)
    assert totals["lost"] > 0
    assert totals["packets"] + totals["lost"] == count
    # a full queue is no reason to wait; the bound leaves room for a busy machine
    assert slowest_s < 1


def test_who_comes_late_has_lost_nothing(
    address: str, processes: Processes, opened: Opened
) -> None:
    sender = opened(address, 0)
    seq = 0

    def send(events: int = 10) -> None:
        nonlocal seq
        sender.write(made(seq, events))
        seq += 1

    for _ in range(150):
        send()
    listener = processes.listener(address)

    def seen() -> bool:
        send()
        return sender.subscribers == 1

    eventually(seen)
    for _ in range(150):
        send()
    report = sender.close()
    totals = result(listener)
    assert totals["seqs"][0] >= 150
    assert totals["seqs"] == list(range(totals["seqs"][0], seq))
    assert (totals["lost"], totals["restarts"], totals["ended"]) == (0, 0, True)
    assert totals["packets"] == report["packets_sent"]
    assert report["packets_sent"] + report["packets_unsubscribed"] == seq
    assert totals["status"]["packets"] == seq


def test_a_killed_subscriber_is_noticed(address: str, processes: Processes, opened: Opened) -> None:
    listener = processes.listener(address)
    sender = opened(address, 1)
    sender.write(made(0, 300))
    assert listener.stdout is not None
    assert listener.stdout.readline() == "first\n"
    os.kill(listener.pid, signal.SIGKILL)
    seq = 0

    def gone() -> bool:
        nonlocal seq
        seq += 1
        sender.write(made(seq, 300))
        return sender.subscribers == 0

    eventually(gone)
    begin_s = monotonic_s()
    report = sender.close()
    # nobody is left to wait for
    assert monotonic_s() - begin_s < 1
    assert report["packets_sent"] + report["packets_unsubscribed"] == seq + 1
    assert report["packets_unsubscribed"] >= 1


def test_a_killed_and_restarted_camera_is_a_restart(address: str, processes: Processes) -> None:
    with subscribe(address, timeout_s=60) as stream:
        first = processes.start(SENDER, address, 50, "hang")
        assert [one.seq for _, one in zip(range(50), stream, strict=False)] == list(range(50))
        os.kill(first.pid, signal.SIGKILL)
        first.wait()
        processes.start(SENDER, address, 30, "end")
        assert [one.seq for one in stream] == list(range(30))
        assert stream.ended
        assert (stream.packets, stream.lost, stream.restarts) == (80, 0, 1)
