"""What a tick of the pencil costs, beside the bare loop under the same forces."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from evs.examples.pencil import TRACKERS
from evs.examples.pencil.controller import Controller, make_tracker
from evs.examples.pencil.environment import PencilLoop
from evs.examples.pencil.stereo import F64
from speed.turns import Table, milliseconds

TICKS = 300
BARE = "the loop alone"


def runs(tracker: str) -> dict[str, Callable[[], object]]:
    """TICKS of one tracker, and the same ticks without its controller."""
    fps = TRACKERS[tracker]
    loop, forces = PencilLoop(fps), list[F64]()

    def controlled() -> None:
        controller, observation = Controller(make_tracker(fps, 0.2)), loop.reset(1)
        forces.clear()
        for _ in range(TICKS):
            forces.append(controller.decide(observation))
            observation = loop.step(forces[-1])
        assert not observation.done

    def bare() -> None:
        loop.reset(1)
        for force in forces:
            loop.step(force)

    controlled()
    return {BARE: bare, "with its controller": controlled}


@pytest.mark.bench
def test_a_tick_of_the_pencil() -> None:
    columns = {}
    for tracker in ("events", "1000 FPS", "30 FPS"):
        times = milliseconds(runs(tracker), 5)
        columns[tracker] = {row: time / TICKS for row, time in times.items()}
    print(Table("a tick, two cameras, one thread", columns, {"with its controller": BARE}))
    for tracker, rows in columns.items():
        print(f"{tracker}: {1.0 / rows['with its controller'].median:.1f} times real time")
    assert all(time.median > 0 for rows in columns.values() for time in rows.values())
