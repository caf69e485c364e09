"""The bus from process to process on this machine, beside bare ZeroMQ with the same bytes.

Both ends check every packet: sorted, inside its interval, on the sensor, padding zero. The
yardstick sends the same three frames and looks at nothing. Packets are offered as fast as the
sender can, no queue is limited, and the time is the receiver's from its first packet to its last.
"""

from __future__ import annotations

import json
import socket
import statistics
import subprocess
import sys

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

SENDER = """
import sys
import numpy as np
from evs.drivers.bus import Publisher
from evs.msgs import EventPacket, StreamInfo, make_events
events, count = map(int, sys.argv[2:4])
t = np.sort(np.random.default_rng(0).integers(1, 1001, events))
body = make_events(t, t % 346, t % 260, t % 2)
sender = Publisher(sys.argv[1], wait_for=1, queue=count + 1, linger_s=60)
sender.open([StreamInfo(346, 260, "cam")])
for seq in range(count):
    sender.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, body, "cam"))
    body["t"] += 1000
sender.close()
"""
RECEIVER = """
import json, sys
from evs.drivers.bus import subscribe
from evs.drivers.pace import monotonic_s
count = int(sys.argv[3])
with subscribe(sys.argv[1], "cam", queue=count + 1, timeout_s=60) as stream:
    assert stream.receive(60) is not None
    begin_s, got = monotonic_s(), 0
    for packet in stream:
        got += len(packet)
        if stream.packets == count:
            break
    print(json.dumps([got, monotonic_s() - begin_s, stream.lost]))
"""
BARE_SENDER = """
import sys
import numpy as np, zmq
events, count = map(int, sys.argv[2:4])
body = np.zeros(16 * events, np.uint8).data
with zmq.Context() as context, context.socket(zmq.XPUB) as server:
    server.set(zmq.SNDHWM, 0)
    server.bind(sys.argv[1])
    server.recv()
    for _ in range(count):
        server.send_multipart([b"events/cam", bytes(92), body])
"""
BARE_RECEIVER = """
import json, sys
import zmq
from evs.drivers.pace import monotonic_s
count, got = int(sys.argv[3]), 0
with zmq.Context() as context, context.socket(zmq.SUB) as client:
    client.set(zmq.RCVHWM, 0)
    client.subscribe(b"events/")
    client.connect(sys.argv[1])
    client.recv_multipart()
    begin_s = monotonic_s()
    for _ in range(count - 1):
        got += len(client.recv_multipart()[2]) // 16
    print(json.dumps([got, monotonic_s() - begin_s, 0]))
"""


def mevs(sender: str, receiver: str, events: int, count: int) -> float:
    """Million events a second, between two new processes."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    arguments = [address, str(events), str(count)]
    with subprocess.Popen([sys.executable, "-c", sender, *arguments]) as publisher:
        said = subprocess.run(
            [sys.executable, "-c", receiver, *arguments], capture_output=True, check=True, text=True
        )
        publisher.wait(60)
    got, seconds, lost = json.loads(said.stdout)
    assert (got, lost) == (events * (count - 1), 0)
    return float(1e-6 * got / seconds)


@pytest.mark.bench
def test_bus_beside_bare_zeromq() -> None:
    print("\nMev/s from process to process, medians, and the share of bare ZeroMQ's")
    for name, (events, count) in SIZES.items():
        rates: dict[str, list[float]] = {"evs": [], "bare": []}
        for _ in range(ROUNDS):
            rates["evs"].append(mevs(SENDER, RECEIVER, events, count))
            rates["bare"].append(mevs(BARE_SENDER, BARE_RECEIVER, events, count))
        ours, bare = (statistics.median(rates[key]) for key in ("evs", "bare"))
        wanted = TARGETS.get(name)
        met = "" if wanted is None else f"  target {wanted:g}: {'met' if ours >= wanted else 'no'}"
        print(f"  {name:14s} evs {ours:7.1f}  bare {bare:7.1f}  {ours / bare:5.2f}{met}")
