"""The bus from process to process on this machine, beside bare ZeroMQ with the same bytes.

Both ends check every packet: sorted, inside its interval, on the sensor, padding zero. The
yardstick sends the same three frames and looks at nothing. Over tcp and over ipc, a socket in the
file system. Packets are offered as fast as the receiver takes them, 8 are under way at most, and
the time is the receiver's from its first packet to its last.
"""

from __future__ import annotations

import json
import socket
import statistics
import subprocess
import sys
from pathlib import Path

import pytest

SIZES = {
    "1,000 events": (1000, 8000),
    "10,000": (10_000, 3000),
    "100,000": (100_000, 600),
    "1,000,000": (1_000_000, 100),
}
"""events of a packet, and how many packets"""
ROUNDS = 5
TARGETS = {"10,000": 10.0, "100,000": 300.0}
"""Mev/s: a packet of 1 ms at 10 Mev/s holds 10,000"""

WINDOW = """
import json, socket, sys, time
events, count = map(int, sys.argv[2:4])
link, free = socket.socket(fileno=int(sys.argv[4])), 8
def await_room():
    global free
    while free <= 0:
        free += len(link.recv(64))
    free -= 1
"""
"""Both ends: a byte back for each packet that was received."""

SENDER = (
    WINDOW
    + """
import numpy as np
from evs.drivers.bus import Publisher
from evs.msgs import EventPacket, StreamInfo, make_events
t = np.sort(np.random.default_rng(0).integers(1, 1001, events))
body = make_events(t, t % 346, t % 260, t % 2)
sender = Publisher(sys.argv[1], wait_for=1, queue=count + 1, linger_s=60)
sender.open([StreamInfo(346, 260, "cam")])
worked_s = time.process_time()
for seq in range(count):
    await_room()
    sender.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, body, "cam"))
    body["t"] += 1000
sender.close()
print(time.process_time() - worked_s)
"""
)
RECEIVER = (
    WINDOW
    + """
from evs.drivers.bus import subscribe
from evs.drivers.clock import monotonic_s
with subscribe(sys.argv[1], "cam", queue=count + 1, timeout_s=60) as stream:
    assert stream.receive(60) is not None
    begin_s, worked_s, got = monotonic_s(), time.process_time(), 0
    link.send(b"x")
    for packet in stream:
        got += len(packet)
        link.send(b"x")
        if stream.packets == count:
            took_s, worked_s = monotonic_s() - begin_s, time.process_time() - worked_s
    print(json.dumps([got, took_s, worked_s, stream.lost]))
"""
)
BARE_SENDER = (
    WINDOW
    + """
import numpy as np, zmq
body = np.zeros(16 * events, np.uint8).data
with zmq.Context() as context, context.socket(zmq.XPUB) as server:
    server.set(zmq.SNDHWM, 0)
    server.bind(sys.argv[1])
    server.recv()
    worked_s = time.process_time()
    for _ in range(count):
        await_room()
        server.send_multipart([b"events/cam", bytes(92), body])
print(time.process_time() - worked_s)
"""
)
BARE_RECEIVER = (
    WINDOW
    + """
import zmq
from evs.drivers.clock import monotonic_s
got = 0
with zmq.Context() as context, context.socket(zmq.SUB) as client:
    client.set(zmq.RCVHWM, 0)
    client.subscribe(b"events/")
    client.connect(sys.argv[1])
    client.recv_multipart()
    begin_s, worked_s = monotonic_s(), time.process_time()
    link.send(b"x")
    for _ in range(count - 1):
        got += len(client.recv_multipart(copy=False)[2]) // 16
        link.send(b"x")
    worked_s = time.process_time() - worked_s
    print(json.dumps([got, monotonic_s() - begin_s, worked_s, 0]))
"""
)


def mevs(sender: str, receiver: str, address: str, events: int, count: int) -> tuple[float, float]:
    """Million events a second between two new processes, ns of processor time an event of both."""
    theirs, ours = socket.socketpair()
    words = [address, str(events), str(count)]
    with theirs, ours:
        at = str(theirs.fileno())
        command = [sys.executable, "-c", sender, *words, at]
        with subprocess.Popen(
            command, pass_fds=(theirs.fileno(),), stdout=subprocess.PIPE
        ) as publisher:
            said = subprocess.run(
                [sys.executable, "-c", receiver, *words, str(ours.fileno())],
                pass_fds=(ours.fileno(),),
                capture_output=True,
                check=True,
                text=True,
            )
            sent = publisher.communicate(timeout=60)[0]
    got, seconds, worked_s, lost = json.loads(said.stdout)
    assert (got, lost) == (events * (count - 1), 0)
    return 1e-6 * got / seconds, 1e9 * (worked_s + json.loads(sent)) / got


def free_port() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{probe.getsockname()[1]}"


@pytest.mark.bench
def test_bus_beside_bare_zeromq(tmp_path: Path) -> None:
    print("\nMev/s from process to process, and ns of processor time an event of both; medians")
    ways = {"evs": (SENDER, RECEIVER), "bare": (BARE_SENDER, BARE_RECEIVER)}
    for name, (events, count) in SIZES.items():
        taken: dict[tuple[str, str], list[tuple[float, float]]] = {}
        for _ in range(ROUNDS):
            for over in ("tcp", "ipc"):
                for way, programs in ways.items():
                    address = free_port() if over == "tcp" else f"ipc://{tmp_path}/bus"
                    found = mevs(*programs, address, events, count)
                    taken.setdefault((over, way), []).append(found)
        for over in ("tcp", "ipc"):
            (ours, our_ns), (bare, bare_ns) = (
                map(statistics.median, zip(*taken[over, way], strict=True)) for way in ways
            )
            told = f"  {name:14s} {over}: evs {ours:6.1f} ({our_ns:5.2f} ns)"
            told += f"  bare {bare:6.1f} ({bare_ns:5.2f} ns)  {ours / bare:4.2f}"
            if (wanted := TARGETS.get(name)) is not None:
                told += f"  target {wanted:g}: {'met' if ours >= wanted else 'no'}"
            print(told)
