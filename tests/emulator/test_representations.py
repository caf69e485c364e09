"""Voxel grid, time surface, event frame and padded packet against plain loops over the events."""

from __future__ import annotations

import math

import numpy as np
import pytest

import evs
from evs.emulator.representations import NEVER, decayed, latest_stamps, padded_packet
from evs.msgs import Events, EvsError, empty_events, join_events, make_events

SIZE = (7, 5)


def some_events(count: int, seed: int, begin_us: int = 0, span_us: int = 5000) -> Events:
    """Random events on SIZE, several of them on one pixel and at one time."""
    rng = np.random.default_rng(seed)
    return make_events(
        np.sort(rng.integers(begin_us + 1, begin_us + span_us + 1, count)),
        rng.integers(0, SIZE[0], count),
        rng.integers(0, SIZE[1], count),
        rng.integers(0, 2, count),
    )


def plain_voxel_grid(events: Events, bins: int, first: int, last: int) -> np.ndarray:
    """Equation (2) of Zhu et al. as it is printed: every event at every bin."""
    grid = np.zeros((bins, SIZE[1], SIZE[0]))
    for event in events:
        t = min(max(int(event["t"]), first), last)
        star = (bins - 1) * (t - first) / (last - first) if last > first else 0.0
        sign = 1 if event["p"] else -1
        for place in range(bins):
            grid[place, event["y"], event["x"]] += sign * max(0.0, 1.0 - abs(place - star))
    return grid


@pytest.mark.parametrize("bins", [1, 2, 5, 10])
@pytest.mark.parametrize("begin_us", [0, 400 * 86_400_000_000])
def test_the_voxel_grid_is_the_papers(bins: int, begin_us: int) -> None:
    events = some_events(400, bins, begin_us)
    grid = evs.voxel_grid(events, bins, SIZE)
    assert (grid.dtype, grid.shape) == (np.float32, (bins, 5, 7))
    wanted = plain_voxel_grid(events, bins, int(events["t"][0]), int(events["t"][-1]))
    # sums of some 20 terms of at most 1, in another order and then in single precision
    assert np.abs(grid - wanted).max() < 1e-5
    assert np.abs(wanted).max() > 1


def test_the_voxel_grid_of_an_interval_holds_everything_inside_it() -> None:
    events = some_events(300, 1, begin_us=1000, span_us=4000)
    grid = evs.voxel_grid(events, 4, SIZE, interval=(2000, 4000))
    assert np.abs(grid - plain_voxel_grid(events, 4, 2000, 4000)).max() < 1e-5
    signs = np.where(events["p"] == 1, 1, -1).sum()
    assert grid.sum() == pytest.approx(signs, abs=1e-3)


def test_events_of_one_instant_are_all_in_the_first_bin() -> None:
    grid = evs.voxel_grid(make_events([9, 9], [1, 2], [0, 0], [1, 0]), 3, SIZE)
    assert (grid[0, 0, 1], grid[0, 0, 2]) == (1, -1)
    assert np.count_nonzero(grid) == 2


def test_the_time_surface_is_that_of_a_plain_loop() -> None:
    events = some_events(60, 2)
    surface = evs.time_surface(events, SIZE, tau_us=1500.0, t_us=6000)
    wanted = np.zeros((2, 5, 7))
    for event in events:
        age_us = 6000 - int(event["t"])
        wanted[event["p"], event["y"], event["x"]] = math.exp(-age_us / 1500.0)
    assert (surface.dtype, surface.shape) == (np.float32, (2, 5, 7))
    assert np.abs(surface - wanted).max() < 1e-6
    assert (surface == 0).any()
    # seen from the last event, that one is new
    assert evs.time_surface(events, SIZE).max() == 1


def test_a_stream_in_pieces_has_the_surface_of_the_whole() -> None:
    pieces = [some_events(40, seed, begin_us=5000 * seed) for seed in range(4)]
    stamps = None
    for piece in [*pieces, empty_events()]:
        before = None if stamps is None else stamps.copy()
        given, stamps = stamps, latest_stamps(piece, SIZE, stamps)
        assert given is None or np.array_equal(given, before)
    whole = latest_stamps(join_events(pieces), SIZE)
    assert np.array_equal(stamps, whole)
    assert (whole == NEVER).sum() < whole.size
    assert np.array_equal(
        decayed(whole, 30_000.0, 20_000),
        evs.time_surface(join_events(pieces), SIZE, t_us=20_000),
    )


def test_stamps_need_not_be_sorted_for_the_newest_to_win() -> None:
    events = make_events([50, 20], [1, 1], [1, 1], [1, 1])
    assert latest_stamps(events, SIZE)[1, 1, 1] == 50


def test_the_event_frame_counts() -> None:
    events = some_events(500, 3)
    wanted = np.zeros((2, 5, 7), int)
    for event in events:
        wanted[event["p"], event["y"], event["x"]] += 1
    frame = evs.event_frame(events, SIZE)
    assert frame.dtype == np.int32
    assert np.array_equal(frame, wanted)
    assert wanted.max() > 1


def test_the_padded_packet_keeps_the_newest() -> None:
    events = some_events(30, 4)
    rows = padded_packet(events, 12, 6000)
    assert (rows.dtype, rows.shape) == (np.int32, (12, 4))
    for row, event in zip(rows, events[-12:], strict=True):
        sign = 1 if event["p"] else -1
        assert tuple(row) == (event["t"] - 6000, event["x"], event["y"], sign)
    rows = padded_packet(events[:5], 12, 6000)
    assert rows[:5, 3].all()
    assert not rows[5:].any()
    # what does not fit into 32 bits is as old as they can say
    assert padded_packet(events[:1], 1, 2**40)[0, 0] == -(2**31)


def test_no_events_are_no_trouble() -> None:
    none = empty_events()
    assert not evs.voxel_grid(none, 3, SIZE).any()
    assert not evs.time_surface(none, SIZE).any()
    assert not evs.event_frame(none, SIZE).any()
    assert not padded_packet(none, 4, 0).any()


@pytest.mark.parametrize(("x", "y"), [(7, 0), (0, 5), (-1, 2), (3, -1)])
def test_an_event_off_the_sensor_is_refused(x: int, y: int) -> None:
    events = make_events([1], [x], [y], [1])
    for make in (
        lambda: evs.voxel_grid(events, 3, SIZE),
        lambda: evs.time_surface(events, SIZE),
        lambda: evs.event_frame(events, SIZE),
    ):
        with pytest.raises(EvsError, match=rf"\({x}, {y}\) is outside 7 x 5"):
            make()


def test_bad_arguments_are_one_line() -> None:
    none = empty_events()
    with pytest.raises(EvsError, match="size is 5: give"):
        evs.event_frame(none, 5)
    with pytest.raises(EvsError, match="size is 0: give at least 1"):
        evs.event_frame(none, (0, 5))
    with pytest.raises(EvsError, match=r"bins is 2\.5: give a whole number"):
        evs.voxel_grid(none, 2.5, SIZE)
    with pytest.raises(EvsError, match="capacity is 0"):
        padded_packet(none, 0, 0)
    with pytest.raises(EvsError, match="tau_us is nan"):
        evs.time_surface(none, SIZE, tau_us=math.nan)
    with pytest.raises(EvsError, match=r"interval .* is empty"):
        evs.voxel_grid(some_events(3, 0), 3, SIZE, interval=(5, 5))
    with pytest.raises(EvsError, match="before has shape"):
        latest_stamps(none, SIZE, np.zeros((2, 7, 5), np.int64))
