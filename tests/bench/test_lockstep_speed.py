"""What lock-step over the wire costs a step: a loop of no cost, beside a bare ZeroMQ round trip.

`.venv/bin/pytest -m bench -s tests/bench/test_lockstep_speed.py`
"""

from __future__ import annotations

import multiprocessing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq
from lockstep_stand_in import StandIn

from evs.drivers.lockstep import LockstepServer, connect
from evs.drivers.pace import monotonic_s
from evs.msgs import EventPacket, Observation, make_events

STEPS = 3000
ROUNDS = 5
TARGET_US = 150.0
BYTES = 600
"""of the bare round trip's answer: about those of a step with some events"""


class Costless(StandIn):
    """Says the same at every step: so many events of one camera."""

    def __init__(self, events: int) -> None:
        super().__init__()
        t = np.sort(np.arange(events) % 1000 + 1)
        body = make_events(t, t % 64, t % 48, t % 2)
        self._packet = EventPacket(0, 0, 1000, 64, 48, body, "left")
        self._told = Observation(1000, (self._packet,), np.zeros(2), np.zeros(2))

    def step(self, ctrl: Any = None, ticks: int = 1) -> Observation:
        return self._told


def serve_loop(address: str, events: int, ready: Any, end: Any) -> None:
    server = LockstepServer(Costless(events), address)
    server.open()
    ready.put(server.address)
    while not end.is_set():
        server.look()
    server.close()


def serve_echo(address: str, _: int, ready: Any, end: Any) -> None:
    with zmq.Context() as context, context.socket(zmq.REP) as server:
        server.set(zmq.LINGER, 0)
        server.set(zmq.RCVTIMEO, 50)
        server.bind(address)
        ready.put(server.get(zmq.LAST_ENDPOINT).rstrip(b"\0").decode())
        answer = bytes(BYTES)
        while not end.is_set():
            try:
                server.recv()
            except zmq.Again:
                continue
            server.send(answer)


class Served:
    """One of the two in a process of its own."""

    def __init__(self, what: Any, address: str, events: int = 0) -> None:
        context = multiprocessing.get_context("spawn")
        ready = context.Queue()
        self._end = context.Event()
        self._process = context.Process(target=what, args=(address, events, ready, self._end))
        self._process.start()
        self.address = ready.get(timeout=60)

    def close(self) -> None:
        self._end.set()
        self._process.join(20)


def quantiles_us(call: Any) -> tuple[float, float]:
    """Median and 99th percentile of a call, us."""
    taken = np.empty(STEPS)
    for place in range(STEPS):
        begin_s = monotonic_s()
        call()
        taken[place] = monotonic_s() - begin_s
    return 1e6 * float(np.median(taken)), 1e6 * float(np.quantile(taken, 0.99))


@pytest.mark.bench
@pytest.mark.parametrize("kind", ["tcp", "ipc"])
def test_what_a_step_over_the_wire_costs(kind: str, tmp_path: Path) -> None:
    def address(name: str) -> str:
        return "tcp://127.0.0.1:0" if kind == "tcp" else f"ipc://{tmp_path}/{name}"

    bind = "tcp://127.0.0.1:*" if kind == "tcp" else address("echo")
    echo = Served(serve_echo, bind)
    loops = {events: Served(serve_loop, address(f"loop{events}"), events) for events in (0, 300)}
    clients = {events: connect(served.address) for events, served in loops.items()}
    control = np.array([0.1, 0.2])
    rows: dict[str, list[tuple[float, float]]] = {}
    with zmq.Context() as context, context.socket(zmq.REQ) as bare:
        bare.set(zmq.LINGER, 0)
        bare.connect(echo.address)

        def round_trip() -> None:
            bare.send(b"x" * 60)
            bare.recv()

        for client in clients.values():
            client.reset()
        for _ in range(ROUNDS):
            # in turns, so that what else the machine does hits all of them
            rows.setdefault("bare REQ/REP round trip", []).append(quantiles_us(round_trip))
            for events, client in clients.items():
                name = f"step of two controls, {events} events back"
                rows.setdefault(name, []).append(quantiles_us(lambda c=client: c.step(control)))
    for client in clients.values():
        client.close()
    for served in (echo, *loops.values()):
        served.close()
    yardstick = float(np.median([median for median, _ in rows["bare REQ/REP round trip"]]))
    print(f"\n{kind}: {STEPS} steps x {ROUNDS}, a loop of no cost in another process")
    for name, found in rows.items():
        median = float(np.median([one for one, _ in found]))
        worst = float(np.median([one for _, one in found]))
        more = median - yardstick
        print(
            f"  {name:42s} median {median:6.1f} us, p99 {worst:7.1f} us, "
            f"{median / yardstick:4.2f} round trips, {more:+6.1f} us over one"
        )
    median = float(np.median([one for one, _ in rows["step of two controls, 0 events back"]]))
    print(f"  target: under {TARGET_US:g} us: {'met' if median < TARGET_US else 'MISSED'}")
