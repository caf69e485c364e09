"""EvSNet per tick on one core: native, dense and sparse, beside onnxruntime in its best layout.

The light is 346 x 260 px: every pixel moves, or some share of the tiles of 4 x 4, each in every
tick. What the runtimes share in Python (checks of the state, events as arrays) is in both times.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.sensor import SensorParameters
from reference.networks import random_network
from speed.turns import Table, Time, milliseconds, target

WIDTH, HEIGHT = 346, 260
SENSOR = SensorParameters("bench", WIDTH, HEIGHT, 0.2, 0.2)
TICKS = 32
"""of one sample; chunks of a network are 1 or 16"""
ROUNDS = 7
PORTABLE, DENSE = "onnxruntime", "native, dense"
SHARES = {"native, 20 % hot": 0.2, "native, 5 % hot": 0.05, "native, 1 % hot": 0.01}
STILL = "native, still"


def film(share: float) -> F32:
    """(TICKS, h, w) float32; that share of the tiles moves, all of it in every tick."""
    rng = np.random.default_rng(1)
    first = rng.uniform(0.05, 1.0, (HEIGHT, WIDTH)).astype(np.float32)
    tiles = rng.random((-(-HEIGHT // 4), -(-WIDTH // 4))) < share
    moves = np.kron(tiles, np.ones((4, 4), bool))[:HEIGHT, :WIDTH]
    walk = np.cumsum(rng.normal(0.0, 0.02, (TICKS, HEIGHT, WIDTH)), axis=0)
    return (first * np.exp(np.where(moves, walk, 0.0))).astype(np.float32)


def stream(model: EvsNetModel, light: F32, chunk: int) -> Callable[[], int]:
    """The film forward or back, in turns, as a stream goes on; how many events."""
    state = model.init(0)
    onwards, back = light, np.ascontiguousarray(light[::-1])

    def run() -> int:
        nonlocal onwards, back, state
        events = 0
        for first in range(0, TICKS, chunk):
            begin_us = 1000 * state.ticks
            found, state = model.step_chunk(onwards[first : first + chunk], state, begin_us, 1000)
            events += sum(map(len, found))
        onwards, back = back, onwards
        return events

    run()  # memory grows here
    return run


@pytest.mark.bench
@pytest.mark.parametrize("channels", [8, 4])
def test_native_network_beside_onnxruntime(channels: int) -> None:
    weights = random_network(0, channels)
    portable = EvsNetModel(SENSOR, weights, runtime="onnxruntime", threads=1)
    dense = EvsNetModel(SENSOR, weights, threads=1, sparse=False)
    sparse = EvsNetModel(SENSOR, weights, threads=1)
    columns: dict[str, dict[str, Time]] = {}
    for chunk in (1, 16):
        calls = {
            PORTABLE: stream(portable, film(1.0), chunk),
            DENSE: stream(dense, film(1.0), chunk),
            **{name: stream(sparse, film(share), chunk) for name, share in SHARES.items()},
            STILL: stream(sparse, film(0.0), chunk),
        }
        taken = milliseconds(calls, ROUNDS)
        columns[f"T = {chunk}"] = {name: time / TICKS for name, time in taken.items()}
    yardsticks = {DENSE: PORTABLE} | dict.fromkeys((*SHARES, STILL), DENSE)
    table = Table(f"one tick of C = {channels}, {WIDTH}x{HEIGHT}, one core", columns, yardsticks)
    print(table)
    if channels == 8:
        faster = table.ratio("T = 16", DENSE)
        print(target("native dense against onnxruntime, T = 16", faster, 3, "x"))
        five = table.ratio("T = 16", "native, 5 % hot")
        print(target("5 % hot against dense, T = 16", five, 10, "x"))
        print(target("dense, T = 16", columns["T = 16"][DENSE].median, 5, "ms"))
    assert all(time.median > 0 for times in columns.values() for time in times.values())


@pytest.mark.bench
def test_instruction_sets_of_the_native_network() -> None:
    weights, light = random_network(0, 8), film(1.0)
    names = [isa for isa in _core.isa_available() if isa != "portable"]
    calls = {
        isa: stream(EvsNetModel(SENSOR, weights, threads=1, isa=isa, sparse=False), light, 16)
        for isa in names
    }
    # each lane of it is a call: a twentieth of the image will do
    sensor = SensorParameters("bench", WIDTH, HEIGHT // 20, 0.2, 0.2)
    slow = EvsNetModel(sensor, weights, threads=1, isa="portable", sparse=False)
    calls["portable"] = stream(slow, np.ascontiguousarray(light[:, : HEIGHT // 20]), 16)
    taken = {isa: time / TICKS for isa, time in milliseconds(calls, 3).items()}
    taken["portable"] = taken["portable"] / (1 / 20)
    print(Table("one tick, dense, C = 8, T = 16", {"ms": taken}, dict.fromkeys(calls, names[0])))
    assert all(time.median > 0 for time in taken.values())
