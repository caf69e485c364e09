"""The native network computes what moves side by side, wherever it lies: nothing of that shows."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.native import LANES, NEVER
from evs.emulator.sensor import SensorParameters
from reference.agreement import run
from reference.networks import random_network

HEIGHT, WIDTH = 10, 23
"""no multiple of 4 either way; 3 x 6 tiles"""
PIXELS = HEIGHT * WIDTH
SLOW = pytest.mark.slow
SENSOR = SensorParameters("test", WIDTH, HEIGHT, 0.2, 0.25)
NETWORKS = {
    "8": random_network(1),
    "centred": random_network(2, 5, 2, look_ahead=3),
    "no blocks": random_network(3, 3, 0),
}


def film(moving: int, ticks: int = 90, seed: int = 0) -> F32:
    """So many pixels move, each from a tick of its own to one of its own; the others never do."""
    rng = np.random.default_rng(seed)
    walk = np.exp(np.cumsum(rng.normal(0, 0.3, (ticks, PIXELS)), axis=0))
    begins, ends = np.sort(rng.integers(1, ticks - 30, (2, PIXELS)), axis=0)
    for pixel in range(PIXELS):
        walk[: begins[pixel], pixel] = walk[begins[pixel], pixel]
        walk[ends[pixel] + 1 :, pixel] = walk[ends[pixel], pixel]
    walk[:, rng.permutation(PIXELS)[moving:]] = 1.0
    return (0.3 * walk).astype(np.float32).reshape(ticks, HEIGHT, WIDTH)


@pytest.mark.parametrize(
    "moving", [0, 1, 16, 17, *(pytest.param(n, marks=SLOW) for n in (2, 15, 48, PIXELS))]
)
@pytest.mark.parametrize("name", NETWORKS)
def test_any_number_of_moving_pixels_is_as_dense(name: str, moving: int) -> None:
    light = film(moving)
    dense = run(EvsNetModel(SENSOR, NETWORKS[name], sparse=False, threads=1), light, cut=32)
    states = []
    for isa in _core.isa_available():
        for cut in (1, 5, 6, 7, 16, 17, 32):
            found = run(EvsNetModel(SENSOR, NETWORKS[name], isa=isa), light, cut=cut)
            assert found.currents.tobytes() == dense.currents.tobytes(), (isa, cut)
            assert [e.tobytes() for e in found.events] == [e.tobytes() for e in dense.events]
            for array in ("v", "last", "tile_moved"):
                assert found.state.arrays[array].tobytes() == dense.state.arrays[array].tobytes()
            states.append(found.state)
    assert all(state == states[0] for state in states)


def test_a_pixel_alone_is_the_pixel_in_a_crowd() -> None:
    crowd = film(PIXELS)
    together = run(EvsNetModel(SENSOR, NETWORKS["8"]), crowd, cut=8)
    for y, x in ((0, 0), (5, 7), (HEIGHT - 1, WIDTH - 1), (3, WIDTH - 1)):
        light = np.full_like(crowd, 0.3)
        light[:, y, x] = crowd[:, y, x]
        alone = run(EvsNetModel(SENSOR, NETWORKS["8"]), light, cut=8)
        assert np.any(alone.currents[:, y, x])
        assert alone.currents[:, y, x].tobytes() == together.currents[:, y, x].tobytes()
        alone.currents[:, y, x] = 0
        assert not np.any(alone.currents)


def test_pixels_that_rest_beside_a_moving_one_remember_nothing() -> None:
    light = np.full((40, HEIGHT, WIDTH), 0.3, np.float32)
    light[20:, 5, 6] = 0.4
    found = run(EvsNetModel(SENSOR, NETWORKS["8"]), light, cut=8)
    lane = 4 * (5 % 4) + 6 % 4
    moved = found.state.arrays["tile_moved"]
    assert moved.shape == (3, 6, LANES)
    assert moved[1, 1, lane] == 20
    assert np.count_nonzero(moved != NEVER) == 1
    row = found.state.arrays["fifo"][found.state.arrays["tile_row"][1, 1]].reshape(LANES, 6, -1)
    assert np.any(row[lane])
    row[lane] = 0
    assert not np.any(row)


def test_what_moved_long_ago_is_not_computed() -> None:
    """Its memory is not even read: damage there does nothing to it while a neighbour moves."""
    light = np.full((160, HEIGHT, WIDTH), 0.3, np.float32)
    light[20:, 5, 6] = 0.4
    light[30:, 5, 5] = 0.4 + 0.01 * np.arange(130, dtype=np.float32)
    model = EvsNetModel(SENSOR, NETWORKS["8"])
    whole, _ = model.step_chunk(light, model.init(0), 0, 1000)
    assert any(map(len, whole[80:]))
    _, state = model.step_chunk(light[:80], model.init(0), 0, 1000)
    row = state.arrays["fifo"][state.arrays["tile_row"][1, 1]].reshape(LANES, 6, -1)
    assert not np.any(row[4 + 2])
    row[4 + 2] = 1.0
    events, _ = model.step_chunk(light[80:], state, 80_000, 1000)
    assert [e.tobytes() for e in events] == [e.tobytes() for e in whole[80:]]
