"""BiLIF by hand: what each line of its rule does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from evs.emulator.evsnet.bilif import BiLIF, Decay, crossing_us, decay_tables
from evs.msgs import EVENT_DTYPE


def halving() -> Decay:
    """d = 1/2, so that every number here is exact."""
    low = np.ldexp(np.ones(256, np.float32), -np.arange(256)).astype(np.float32)
    low[101:] = 0
    return Decay(low, np.concatenate([np.ones(1), np.zeros(4095)]).astype(np.float32))


def keeping() -> Decay:
    """d = 1."""
    return Decay(np.ones(256, np.float32), np.ones(4096, np.float32))


@dataclass
class Pixel:
    """One pixel through its ticks of 1000 us."""

    unit: BiLIF
    v0: float = 0.0
    tick_us: int = 1000

    def __post_init__(self) -> None:
        self.v = np.full((1, 1), self.v0, np.float32)
        self.last = np.zeros((1, 1), np.int64)
        self.clamped = 0

    def run(self, currents: list[float]) -> list[tuple[int, int, float]]:
        """(event: +1, 0, -1; stamp after the tick's start or 0; v) of each tick."""
        out = []
        for tick, current in enumerate(currents):
            frame = np.full((1, 1), current, np.float32)
            events, clamped = self.unit.step(
                frame, self.v, self.last, tick, tick * self.tick_us, self.tick_us
            )
            self.clamped += clamped
            assert len(events) <= 1
            event, stamp = 0, 0
            if len(events):
                event = 1 if events["p"][0] else -1
                stamp = int(events["t"][0]) - tick * self.tick_us
            out.append((event, stamp, float(self.v[0, 0])))
        return out


def unit(on: float = 1.0, off: float = 1.0, decay: Decay | None = None) -> BiLIF:
    return BiLIF(np.float32(on), np.float32(off), decay or keeping())


def test_charge_fire_reset_of_both_polarities() -> None:
    pixel = Pixel(unit())
    assert pixel.run([0.5, 0.25, 0.75, -1.0, -1.0]) == [
        (0, 0, 0.5),
        (0, 0, 0.75),
        (1, 334, 0.5),  # 1/4 of the 3/4 were missing, a third of the tick
        (0, 0, -0.5),
        (-1, 500, -0.5),
    ]


def test_a_threshold_just_reached_fires() -> None:
    for current, event in ((1.0, 1), (-1.0, -1)):
        assert Pixel(unit()).run([current]) == [(event, 1000, 0.0)]
        below = float(np.nextafter(np.float32(current), np.float32(0)))
        assert Pixel(unit()).run([below]) == [(0, 0, below)]


def test_thresholds_of_two_sizes() -> None:
    pixel = Pixel(unit(on=0.5, off=2.0))
    assert pixel.run([0.5, -1.5, -0.5, 0.75]) == [
        (1, 1000, 0.0),
        (0, 0, -1.5),
        (-1, 1000, 0.0),
        (1, 667, 0.25),
    ]


def test_leak_of_the_ticks_between() -> None:
    pixel = Pixel(unit(decay=halving()), v0=0.75)
    # two ticks without current: v is told as of the last active tick, then halved three times
    assert pixel.run([0.0, 0.0, 0.0, 0.125]) == [
        (0, 0, 0.75),
        (0, 0, 0.75),
        (0, 0, 0.75),
        (0, 0, 0.75 / 8 + 0.125),
    ]
    assert pixel.last[0, 0] == 3


def test_leak_alone_never_fires() -> None:
    pixel = Pixel(unit(decay=halving()), v0=float(np.nextafter(np.float32(1), np.float32(0))))
    assert {event for event, _, _ in pixel.run([0.0] * 300)} == {0}


def test_leak_comes_before_the_charge() -> None:
    """A membrane of 1/2 that gets 1/2 would fire, if it were not 1/4 by then."""
    assert Pixel(unit(decay=halving()), v0=0.0).run([0.5, 0.5, 0.625])[1:] == [
        (0, 0, 0.75),
        (1, 1000, 0.0),
    ]


def test_saturation_one_event_a_tick_until_it_is_spent() -> None:
    trail = Pixel(unit()).run([5.25, *[0.0] * 8])
    assert [event for event, _, _ in trail] == [1, 1, 1, 1, 1, 0, 0, 0, 0]
    # the first where the line crosses, the others at once
    assert [stamp for _, stamp, _ in trail] == [191, 1, 1, 1, 1, 0, 0, 0, 0]
    assert trail[-1][2] == 0.25


def test_the_trail_leaks() -> None:
    trail = Pixel(unit(decay=halving())).run([8.0, *[0.0] * 6])
    # 8 -> 7 -> 3.5 - 1 -> 1.25 - 1 -> .25, told as of then
    assert [(event, v) for event, _, v in trail] == [
        (1, 7.0),
        (1, 2.5),
        (1, 0.25),
        *[(0, 0.25)] * 4,
    ]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_huge_step_is_clamped_and_counted(sign: int) -> None:
    pixel = Pixel(unit())
    trail = pixel.run([sign * 1e30, *[0.0] * 70])
    assert pixel.clamped == 1
    assert sum(event for event, _, _ in trail) == sign * 64
    assert [event for event, _, _ in trail[64:]] == [0] * 7
    assert trail[0][1:] == (1, sign * 63.0)


def test_the_clamp_is_counted_every_time() -> None:
    pixel = Pixel(unit())
    pixel.run([100.0, 100.0, 1.0, 0.5, -200.0])
    # 64, 63 + 100, 64 of 63 + 1, 63.5, 62.5 - 200
    assert pixel.clamped == 3


def test_infinite_and_missing_currents_leave_a_membrane_that_works() -> None:
    pixel = Pixel(unit())
    trail = pixel.run([0.5, float("nan"), 0.5, float("inf"), float("-inf"), *[0.0] * 70, 1.0])
    assert trail[:4] == [(0, 0, 0.5), (0, 0, 0.5), (1, 1000, 0.0), (1, 1, 63.0)]
    assert trail[4] == (-1, 1, -63.0)
    assert pixel.clamped == 3
    assert trail[-2] == (0, 0, 0.0)
    assert trail[-1] == (1, 1000, 0.0)


def test_crossing_stamps() -> None:
    def stamp(level: float, before: float, charge: float, tick_us: int = 1000) -> int:
        args = np.array([level]), np.array([before], np.float32), np.array([charge], np.float32)
        return int(crossing_us(*args, tick_us)[0])

    assert stamp(1.0, 0.0, 1.0) == 1000
    assert stamp(1.0, 0.0, 4.0) == 250
    assert stamp(1.0, 0.0, 3.0) == 334  # rounded up
    assert stamp(-1.0, 0.0, -4.0) == 250
    assert stamp(-2.0, -1.5, -1.0) == 500
    assert stamp(1.0, 0.999, 1000.0) == 1  # not 0: the start belongs to the tick before
    assert stamp(1.0, 1.0, 1.0) == 1  # there already
    assert stamp(1.0, 5.0, -3.0) == 1
    assert stamp(1.0, 0.0, 1.0, tick_us=1) == 1
    assert stamp(1.0, 0.25, 1.0, tick_us=2**28 - 1) == 201326592


def test_events_of_a_tick_are_sorted_by_time_then_by_pixel() -> None:
    current = np.array([[1.0, 2.0, -2.0], [4.0, 0.0, 2.0]], np.float32)
    v, last = np.zeros((2, 3), np.float32), np.zeros((2, 3), np.int64)
    events, _ = unit().step(current, v, last, 7, 7000, 1000)
    assert events.dtype == EVENT_DTYPE
    assert events.tolist() == [
        (7250, 0, 1, 1),
        (7500, 1, 0, 1),
        (7500, 2, 0, 0),
        (7500, 2, 1, 1),
        (8000, 0, 0, 1),
    ]
    assert not np.any(np.frombuffer(events.tobytes(), np.uint8).reshape(-1, 16)[:, 13:])
    # the pixel without current is as it was
    assert last.tolist() == [[7, 7, 7], [7, 0, 7]]


def test_untouched_pixels_hold_their_bits() -> None:
    v = np.array([[0.3, -0.7, 0.0]], np.float32)
    kept, last = v.copy(), np.zeros((1, 3), np.int64)
    tables = decay_tables(0.4, 1000)
    for tick in range(50):
        current = np.array([[0.0, -0.0, 0.0]], np.float32)
        events, _ = unit(decay=tables).step(current, v, last, tick, tick * 1000, 1000)
        assert len(events) == 0
    assert v.tobytes() == kept.tobytes()
    assert not last.any()
