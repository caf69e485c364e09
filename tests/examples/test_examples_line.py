"""Lines from events and from frames, against lines that are known."""

from __future__ import annotations

import numpy as np
import pytest

from evs.examples.pencil.line_tracker import (
    EventLineTracker,
    FrameLineTracker,
    PrincipalPoint,
    StickLine,
)
from evs.examples.pencil.stereo import DISTANCE_M, FOCAL_PX, Stick, combine, stick_line
from evs.msgs import EVENT_DTYPE, Events, EvsError

HEIGHT_PX = 98
ORIGIN = PrincipalPoint()


def edge_events(line: StickLine, random: np.random.Generator, half_px: float = 1.7) -> Events:
    """An event on each edge of each row, in random order, where a pixel is nearest to the edge."""
    rows = np.arange(20, 20 + HEIGHT_PX)
    middle = ORIGIN.x + line.base + line.slope * (ORIGIN.y - rows)
    x = np.concatenate([middle - half_px, middle + half_px])
    # what is nearly covered lies inside of the edge
    x -= 0.4 * np.sign(x - np.tile(middle, 2))
    events = np.zeros(2 * len(rows), EVENT_DTYPE)
    order = random.permutation(len(events))
    events["x"], events["y"] = np.rint(x)[order], np.tile(rows, 2)[order]
    events["t"] = np.arange(len(events))
    return events


@pytest.mark.parametrize("slope", [-0.2, 0.0, 0.03, 0.2])
def test_events_of_a_line_say_that_line(slope: float) -> None:
    random = np.random.default_rng(7)
    wanted, tracker = StickLine(0.0, slope), EventLineTracker(HEIGHT_PX)
    for step in range(1, 41):
        # a stick may lean, but not jump, between two packets
        now = StickLine(0.0, slope * min(1.0, step / 30))
        found = tracker.update(edge_events(now, random))
    # whole pixels: up to half of one, over many rows a fraction of that
    assert abs(found.slope - wanted.slope) * HEIGHT_PX < 0.4
    assert abs(found.base - wanted.base) < 0.3


def test_noise_and_other_things_pull_little() -> None:
    random = np.random.default_rng(3)
    clean, dirty = EventLineTracker(HEIGHT_PX), EventLineTracker(HEIGHT_PX)
    for step in range(1, 31):
        events = edge_events(StickLine(0.0, 0.1 * step / 30), random)
        found = clean.update(events)
        noise = np.zeros(60, EVENT_DTYPE)
        noise["x"], noise["y"] = random.integers(0, 128, (2, 60))
        both = np.concatenate([events, noise])
        both["t"] = random.permutation(len(both))
        also = dirty.update(both[np.argsort(both["t"], kind="stable")])
    # a quarter of the events is noise, most of it far away
    assert abs(also.slope - found.slope) * HEIGHT_PX < 0.5


def test_without_events_the_line_stays_and_its_base_goes_with_the_cup() -> None:
    random = np.random.default_rng(1)
    tracker = EventLineTracker(HEIGHT_PX)
    before = tracker.update(edge_events(StickLine(0.0, 0.05), random))
    after = tracker.update(np.zeros(0, EVENT_DTYPE), cup_px=4.0)
    assert after.slope == before.slope
    assert after.base == pytest.approx(before.base + 4.0)


def test_the_packets_size_does_not_matter_much() -> None:
    # Gaussian and sides are of the line before the packet: all else is the same sums
    random = np.random.default_rng(5)
    whole, pieces = EventLineTracker(HEIGHT_PX), EventLineTracker(HEIGHT_PX)
    for _ in range(5):
        for tracker in (whole, pieces):
            tracker.update(edge_events(StickLine(0.0, 0.02), np.random.default_rng(6)))
    events = edge_events(StickLine(0.0, 0.025), random)
    at_once = whole.update(events)
    for part in np.array_split(events, 8):
        by_and_by = pieces.update(part)
    assert abs(at_once.slope - by_and_by.slope) * HEIGHT_PX < 0.3


def test_a_tracker_that_makes_no_sense_is_refused() -> None:
    for bad in ({"height_px": 0.0}, {"height_px": 1.0}, {"height_px": 50.0, "sigma_px": 0.0}):
        with pytest.raises(EvsError, match="a line needs"):
            EventLineTracker(**bad)


def picture(line: StickLine, half_px: float = 1.7) -> np.ndarray:
    """A dark stick on a bright ground, each pixel as dark as it is covered; 8 bits."""
    rows = np.arange(20, 20 + HEIGHT_PX)
    middle = ORIGIN.x + line.base + line.slope * (ORIGIN.y - rows)
    x = np.arange(128)
    left, right = middle[:, None] - half_px, middle[:, None] + half_px
    covered = np.clip(np.minimum(x + 0.5, right) - np.maximum(x - 0.5, left), 0.0, 1.0)
    pixels = np.full((128, 128), 220.0)
    pixels[rows] -= 180.0 * covered
    # the cart below the cup is no part of the stick
    pixels[121:] = 90.0
    return np.rint(pixels).astype(np.uint8)


@pytest.mark.parametrize(
    "line", [StickLine(0.0, 0.0), StickLine(-20.3, 0.21), StickLine(31.7, -0.33)]
)
def test_a_frame_says_its_line(line: StickLine) -> None:
    found = FrameLineTracker(128, 128).update(picture(line))
    assert found is not None
    # 8 bits and a threshold of a tenth of the ground's light
    assert abs(found.slope - line.slope) < 0.002
    assert abs(found.base - line.base) < 0.1


def test_a_frame_without_a_stick_says_nothing() -> None:
    fit = FrameLineTracker(128, 128)
    assert fit.update(np.full((128, 128), 220, np.uint8)) is None
    assert fit.update(np.zeros((128, 128), np.uint8)) is None


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.4)])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.09, -0.08)])
def test_two_views_say_tilt_and_place(
    tilt: tuple[float, float], place: tuple[float, float]
) -> None:
    (x, y), (p, q) = place, np.tan(tilt)

    # the projection itself, of two points of the stick
    def seen(z: float) -> tuple[float, float, float, float]:
        left, right = DISTANCE_M + y + q * z, DISTANCE_M - x - p * z
        along, across = FOCAL_PX * (x + p * z) / left, FOCAL_PX * (y + q * z) / right
        return along, FOCAL_PX * z / left, across, FOCAL_PX * z / right

    foot, top = np.array(seen(0.0)), np.array(seen(0.2))
    lines = [StickLine(foot[k], (top[k] - foot[k]) / (top[k + 1] - foot[k + 1])) for k in (0, 2)]
    stick = combine(*lines)
    np.testing.assert_allclose(stick.tilt, tilt, atol=1e-12)
    np.testing.assert_allclose(stick.place, place, atol=1e-12)
    # and back
    for k in (0, 1):
        again = stick_line(Stick(np.array(tilt), np.array(place)), k)
        assert again.base == pytest.approx(lines[k].base, abs=1e-9)
        assert again.slope == pytest.approx(lines[k].slope, abs=1e-12)
