"""The ends of lock-step's bench in processes of their own: a loop of no cost, and a bare echo."""

from __future__ import annotations

import multiprocessing
from typing import Any

import numpy as np
import zmq
from lockstep_stand_in import StandIn

from evs.drivers.lockstep import LockstepServer
from evs.msgs import EventPacket, Observation, make_events

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
        server.poll()
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
