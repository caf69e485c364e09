"""What publishing costs the camera: a tick of about 1 ms on one core, with and without listeners.

The camera, ZeroMQ's own thread with it, is pinned to one core; `evs record` and a counter are
processes on the others. Each tick sends 5000 events: 5 Mev/s at 1 ms. The two ways take turns. Time
is the camera's own on its core, both threads, which is the same however busy the machine is.
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
from evs.drivers.checkup.loopback import free_address
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


def ticks(sender: Publisher, seq: int, body: np.ndarray) -> float:
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
    heard, unheard = (
        Publisher(free_address(), wait_for=2, wait_s=60),
        Publisher("tcp://127.0.0.1:0"),
    )
    program = [sys.executable, "-m", "evs.launch.main"]
    others = [
        subprocess.Popen([*program, "record", heard._wanted_address, str(tmp_path / "run.aedat4")]),
        subprocess.Popen([*program, "echo", heard._wanted_address, "--quiet"]),
    ]
    for other in others:
        os.sched_setaffinity(other.pid, cores[1:] or cores)
    os.sched_setaffinity(0, cores[:1])
    try:
        stream = StreamInfo(346, 260, "cam")
        heard.open([stream])
        unheard.open([stream])
        taken: dict[Publisher, list[float]] = {heard: [], unheard: []}
        stamps = np.sort(np.random.default_rng(0).integers(1, 1001, EVENTS))
        bodies = {
            one: make_events(stamps - 1000, stamps % 346, stamps % 260, stamps % 2) for one in taken
        }
        for turn in range(ROUNDS + 1):
            for one, seconds in taken.items():
                seconds.append(ticks(one, turn * TICKS, bodies[one]))
        said = heard.close()
        unheard.close()
    finally:
        os.sched_setaffinity(0, cores)
        for other in others:
            other.wait(60)
    ours, bare = (1e3 * statistics.median(taken[one][1:]) / TICKS for one in (heard, unheard))
    print(f"\nms a tick: {bare:.3f} with nobody, {ours:.3f} with two processes that listen")
    print(f"{said['events_sent'] / 1e6:.1f} million events were sent, 5000 a tick")
    print(target("a tick is slowed by", 100 * (ours / bare - 1), 5.0, "%"))
