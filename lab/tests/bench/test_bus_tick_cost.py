"""What publishing costs the camera: a tick of about 1 ms on one core, with and without listeners.

The camera, ZeroMQ's own thread with it, is pinned to one core; `evs record` and a counter are
processes on the others. Each tick sends 5000 events: 5 Mev/s at 1 ms. Three ways take turns: nobody
listens, two do, two do and the publisher runs in a worker on the other cores. Time is the camera's
own on its core, all threads, which is the same however busy the machine is.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.bus import Publisher
from evs.drivers.bus.address import free_address
from evs.drivers.run.config import make_sink
from evs.drivers.sink import Sink
from evs.drivers.sink_config import SinkConfig
from evs.msgs import EventPacket, StreamInfo, make_events
from speed.turns import target

EVENTS = 5000
TICKS = 300
"""of one sample"""
ROUNDS = 9
LIGHT = np.random.default_rng(0).random(90_000)


def work() -> float:
    """About a millisecond of arithmetic on what a core's cache holds, as a tick has."""
    total = 0.0
    for _ in range(2):
        total += float(np.log(LIGHT + 1.0).sum())
    return total


def ticks(sender: Sink, seq: int, body: np.ndarray) -> float:
    """Seconds of the core that TICKS take, events included; they are made either way."""
    begin_s = time.process_time()
    for place in range(seq, seq + TICKS):
        work()
        body["t"] += 1000
        base_us = 1000 * place
        sender.write(EventPacket(place, base_us, base_us + 1000, 346, 260, body, "cam"))
    return time.process_time() - begin_s


@pytest.mark.bench
def test_publishing_beside_a_tick(tmp_path: Path) -> None:
    cores = sorted(os.sched_getaffinity(0))
    rest = tuple(cores[1:] or cores)
    addresses = {"beside": free_address(), "worker": free_address()}
    ways: dict[str, Sink] = {
        "nobody": Publisher("tcp://127.0.0.1:0"),
        "beside": Publisher(addresses["beside"], wait_for=2, wait_s=60),
        "worker": make_sink(
            SinkConfig.of(
                type="zmq",
                address=addresses["worker"],
                wait_for=2,
                wait_s=60.0,
                worker=True,
                worker_cores=rest,
            )
        ),
    }
    program = [sys.executable, "-m", "evs.launch.main"]
    others = [
        subprocess.Popen([*program, *words], stdout=subprocess.DEVNULL)
        for way, address in addresses.items()
        for words in (
            ("record", address, str(tmp_path / f"{way}.aedat4")),
            ("echo", address, "--quiet"),
        )
    ]
    for other in others:
        os.sched_setaffinity(other.pid, rest)
    os.sched_setaffinity(0, cores[:1])
    try:
        stream = StreamInfo(346, 260, "cam")
        for sink in ways.values():
            sink.open([stream])
        taken: dict[str, list[float]] = {way: [] for way in ways}
        stamps = np.sort(np.random.default_rng(0).integers(1, 1001, EVENTS))
        bodies = {
            way: make_events(stamps - 1000, stamps % 346, stamps % 260, stamps % 2) for way in ways
        }
        for turn in range(ROUNDS + 1):
            for way, sink in ways.items():
                taken[way].append(ticks(sink, turn * TICKS, bodies[way]))
                # what waits for the others is not the next one's
                time.sleep(0.3)
        said = {way: sink.close() for way, sink in ways.items()}
    finally:
        os.sched_setaffinity(0, cores)
        for other in others:
            other.wait(60)
    ms = {way: 1e3 * statistics.median(taken[way][1:]) / TICKS for way in ways}
    told = ", ".join(f"{way} {one:.3f}" for way, one in ms.items())
    print(f"\nms a tick of 5000 events, two listeners or nobody: {told}")
    for way in addresses:
        print(f"{way}: {said[way]['events_sent'] / 1e6:.1f} million events were sent")
    print(f"worker: {said['worker']['worker_packets_dropped']} packets dropped")
    for way in addresses:
        slower = 100 * (ms[way] / ms["nobody"] - 1)
        print(target(f"{way}: a tick is slowed by", slower, 5.0, "%"))
