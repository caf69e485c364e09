"""StackedArrays: row by row the bytes of the functions of evs.emulator.representations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evs.emulator.representations import (
    decayed,
    event_frame,
    latest_stamps,
    padded_packet,
    voxel_grid,
)
from evs.emulator.simulation.stacked_arrays import KINDS, StackedArrays
from evs.emulator.simulation.world_batch import stacked
from evs.emulator.simulation.worlds import WorldsEvents
from evs.msgs import Events, EvsError, make_events

SIZE = (33, 20)
COUNTS = (0, 1, 5000, 70, 3)
BEGIN_US = np.array([0, 1000, 2000, 500, 7])


def some_events(seed: int, later_us: int = 0) -> list[Events]:
    """Of each world, all within 10 ms of its beginning; some pixels fire hundreds of times."""
    rng = np.random.default_rng(seed)
    worlds = []
    for count, begin_us in zip(COUNTS, BEGIN_US.tolist(), strict=True):
        times = np.sort(rng.integers(1, 10_001, count)) + begin_us + later_us
        places = (rng.integers(0, SIZE[0], count) ** 2) % SIZE[0], rng.integers(0, SIZE[1], count)
        worlds.append(make_events(times, *places, rng.integers(0, 2, count)))
    return worlds


def side_by_side(worlds: list[Events]) -> WorldsEvents:
    return WorldsEvents(*stacked(worlds, [len(events) for events in worlds]))


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("bins", [1, 2, 3, 5, 9])
def test_voxel_grids(bins: int, threads: int) -> None:
    worlds = some_events(bins)
    grids = StackedArrays("voxel_grid", 5, SIZE, bins=bins, threads=threads)
    # a part of the events lies outside of the interval
    found = grids.encode(side_by_side(worlds), BEGIN_US + 500, BEGIN_US + 9000)
    assert (found.shape, found.dtype) == ((5, bins, SIZE[1], SIZE[0]), np.float32)
    for row, events, begin_us in zip(found, worlds, BEGIN_US.tolist(), strict=True):
        one = voxel_grid(events, bins, SIZE, (begin_us + 500, begin_us + 9000))
        assert row.tobytes() == np.clip(one, -255, 255).tobytes()


def test_event_frames_are_full_at_255() -> None:
    worlds = some_events(1)
    worlds[2]["x"], worlds[2]["y"] = 4, 3
    found = StackedArrays("event_frame", 5, SIZE).encode(side_by_side(worlds), 0, 1)
    assert found.dtype == np.uint8
    assert found.max() == 255
    for row, events in zip(found, worlds, strict=True):
        assert np.array_equal(row, np.minimum(event_frame(events, SIZE), 255))


def test_time_surfaces_remember_until_a_reset() -> None:
    surfaces = StackedArrays("time_surface", 5, SIZE, tau_us=3000.0)
    stamps: list[Any] = [None] * 5
    for step in range(4):
        worlds = some_events(step, 10_000 * step)
        end_us = BEGIN_US + 10_000 * (step + 1)
        if step == 2:
            surfaces.reset([0, 2])
            assert not surfaces.array[[0, 2]].any()
            stamps[0] = stamps[2] = None
        found = surfaces.encode(side_by_side(worlds), 0, end_us)
        for world, events in enumerate(worlds):
            stamps[world] = latest_stamps(events, SIZE, stamps[world])
            one = decayed(stamps[world], 3000.0, int(end_us[world]))
            assert found[world].tobytes() == one.tobytes()


def test_a_decay_is_that_of_numpy_to_the_last_bits_of_float32() -> None:
    ages = np.concatenate([np.arange(2000), np.geomspace(2000, 2e6, 3000)]).astype(np.int64)
    exact = np.exp(-ages / 20_000.0)
    found = decayed(-ages.reshape(1, 1, -1), 20_000.0, 0).reshape(-1)
    usual = exact > 1e-37
    np.testing.assert_array_max_ulp(found[usual], exact[usual].astype(np.float32), maxulp=1)
    assert (np.abs(found[~usual] - exact[~usual]) < 1e-38).all()


def test_packets() -> None:
    worlds = some_events(1)
    packets = StackedArrays("packet", 5, SIZE, capacity=60)
    found = packets.encode(side_by_side(worlds), 0, BEGIN_US + 10_000)
    for row, events, begin_us in zip(found, worlds, BEGIN_US.tolist(), strict=True):
        assert row.tobytes() == padded_packet(events, 60, begin_us + 10_000).tobytes()


@pytest.mark.parametrize("kind", KINDS)
def test_the_memory_is_one_and_shared(kind: str) -> None:
    arrays = StackedArrays(kind, 5, SIZE)
    first = arrays.encode(side_by_side(some_events(1)), BEGIN_US, BEGIN_US + 10_000)
    assert first is arrays.encode(side_by_side(some_events(2)), BEGIN_US, BEGIN_US + 10_000)
    assert np.shares_memory(np.from_dlpack(first), first)


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        (("film", 2, SIZE), {}, "film"),
        (("packet", 0, SIZE), {}, "count is 0"),
        (("packet", 2, SIZE), {"capacity": 0}, "capacity is 0"),
        (("voxel_grid", 2, SIZE), {"bins": 0}, "bins is 0"),
        (("time_surface", 2, SIZE), {"tau_us": 0.0}, "tau_us is 0"),
        (("event_frame", 2, (0, 5)), {}, "size is"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: Any, options: Any, words: str) -> None:
    with pytest.raises(EvsError, match=words):
        StackedArrays(*arguments, **options)


def test_events_of_others_are_refused() -> None:
    arrays = StackedArrays("event_frame", 4, SIZE)
    with pytest.raises(EvsError, match="another number of worlds"):
        arrays.encode(side_by_side(some_events(1)), 0, 1)
    small = StackedArrays("event_frame", 5, (8, 20))
    with pytest.raises(EvsError, match="outside the sensor"):
        small.encode(side_by_side(some_events(1)), 0, 1)
