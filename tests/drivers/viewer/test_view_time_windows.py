"""Windows of events and their sketch in characters."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.viewer import Window, WindowBuilder, sketch
from evs.msgs import EventPacket, make_events

ESCAPE = re.compile(r"\x1b\[[0-9;]*m")


def packet(begin_us: int, end_us: int, events: list[tuple[int, int, int, int]]) -> EventPacket:
    columns = np.array(events, np.int64).reshape(-1, 4).T
    return EventPacket(0, begin_us, end_us, 8, 6, make_events(*columns), "eye")


def gathered(packets: list[EventPacket], period_us: int = 20_000) -> list[Window]:
    builder = WindowBuilder("eye", 8, 6, period_us)
    found = [window for one in packets for window in builder.add(one)]
    return [*found, *builder.rest()]


def test_a_window_shows_each_pixels_last_event_and_the_rates() -> None:
    first, second = gathered(
        [
            packet(0, 10_000, [(1, 2, 3, 1), (5, 2, 3, 0), (10_000, 7, 5, 1)]),
            # an event at the very end of a window is of that window, as in a tick
            packet(10_000, 30_000, [(20_000, 0, 0, 0), (20_001, 1, 1, 1)]),
        ]
    )
    assert (first.end_us, first.on, first.off) == (20_000, 2, 2)
    assert (first.on_hz, first.off_hz) == (100.0, 100.0)
    wanted = np.zeros((6, 8), np.uint8)
    wanted[3, 2], wanted[5, 7], wanted[0, 0] = 1, 2, 1
    assert np.array_equal(first.picture, wanted)
    assert (second.end_us, second.on, second.off) == (40_000, 1, 0)
    assert np.argwhere(second.picture).tolist() == [[1, 1]]


def test_windows_without_events_come_too_but_not_those_of_a_long_gap() -> None:
    quiet = gathered([packet(20_000 * k, 20_000 * k + 20_000, []) for k in range(4)])
    assert [window.end_us for window in quiet] == [20_000, 40_000, 60_000, 80_000]
    jump = gathered([packet(0, 1000, [(1, 0, 0, 1)]), packet(10**9, 10**9 + 20_000, [])])
    assert [(window.end_us, window.on) for window in jump] == [(20_000, 1), (10**9 + 20_000, 0)]


def test_a_new_run_begins_anew() -> None:
    found = gathered([packet(10**6, 10**6 + 1000, [(10**6 + 1, 0, 0, 1)]), packet(0, 20_000, [])])
    assert [(window.end_us, window.on) for window in found] == [(20_000, 0)]


@given(
    st.lists(st.tuples(st.integers(1, 9000), st.integers(0, 60)), max_size=12),
    st.integers(1, 30_000),
)
def test_every_event_is_in_one_window(steps: list[tuple[int, int]], period_us: int) -> None:
    packets, now, count = [], 0, 0
    for length, events in steps:
        random = np.random.default_rng(events)
        stamps = np.sort(random.integers(now + 1, now + length + 1, events))
        packets.append(packet(now, now + length, [(int(t), 1, 2, t % 2) for t in stamps]))
        now, count = now + length, count + events
    windows = gathered(packets, period_us)
    assert sum(window.on + window.off for window in windows) == count
    ends = [window.end_us for window in windows]
    assert ends == sorted(set(ends))
    assert all(end % period_us == 0 for end in ends)


def test_the_dots_of_a_sketch_lie_where_the_pixels_are() -> None:
    picture = np.zeros((8, 4), np.uint8)
    picture[0, 0], picture[3, 1], picture[7, 3] = 2, 2, 1
    # two dots in the upper left cell (1 and 8 of braille's), one in the lower right
    assert sketch(picture, 80, 24, colours=False) == ["⢁", "⠀⢀"]
    coloured = sketch(picture, 80, 24)
    assert [ESCAPE.sub("", line) for line in coloured] == ["⢁", "⠀⢀"]
    assert "\x1b[38;2;0;114;255m⢁\x1b[0m" in coloured[0]
    assert "\x1b[38;2;224;48;16m⢀\x1b[0m" in coloured[1]
    assert sketch(picture, 80, 24, colours=False, braille=False) == [":", " ."]


@pytest.mark.parametrize("colours", [True, False])
@given(st.integers(1, 700), st.integers(1, 500), st.integers(1, 200), st.integers(1, 60), st.data())
def test_a_sketch_fits_the_terminal_and_shows_every_pixel(
    colours: bool, width: int, height: int, columns: int, rows: int, data: st.DataObject
) -> None:
    picture = np.zeros((height, width), np.uint8)
    assert "".join(sketch(picture, columns, rows)).strip() == ""
    x, y = data.draw(st.integers(0, width - 1)), data.draw(st.integers(0, height - 1))
    picture[y, x] = 2
    lines = [ESCAPE.sub("", line) for line in sketch(picture, columns, rows, colours=colours)]
    assert len(lines) <= rows
    assert max(map(len, lines)) <= columns
    # one dot, in its place
    (row,) = [k for k, line in enumerate(lines) if line.strip("⠀")]
    (column,) = [k for k, letter in enumerate(lines[row]) if letter != "⠀"]
    assert bin(ord(lines[row][column]) - 0x2800).count("1") == 1
    assert abs((row + 0.5) / len(lines) - (y + 0.5) / height) <= 1 / len(lines) + 1 / height
