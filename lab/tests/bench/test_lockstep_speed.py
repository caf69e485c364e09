"""What lock-step over the wire costs a step: a loop of no cost, beside a bare ZeroMQ round trip.

`.venv/bin/pytest -m bench -s lab/tests/bench/test_lockstep_speed.py`
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq

from evs.drivers.clock import monotonic_s
from evs.drivers.lockstep import connect
from speed.lockstep_servers import Served, serve_echo, serve_loop

STEPS = 3000
ROUNDS = 5
TARGET_US = 150.0


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
