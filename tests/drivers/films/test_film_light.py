"""Frames on the sensor: the mean light of each pixel's area, and straight lines between frames."""

from __future__ import annotations

import numpy as np
import pytest

from evs.drivers.films.fitting import area_mean, region
from evs.drivers.films.source import natural_order
from evs.drivers.films.world import between
from evs.msgs import EvsError


def mean_of_areas(light: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The same from its definition: every pixel is cut into pieces that no border crosses."""
    rows, columns = shape
    fine = np.repeat(np.repeat(light.astype(np.float64), rows, 0), columns, 1)
    high, wide = light.shape
    return fine.reshape(rows, high, columns, wide).mean((1, 3))


@pytest.mark.parametrize("size", [(12, 16), (7, 5), (13, 31), (1, 1), (24, 40)])
@pytest.mark.parametrize("shape", [(6, 8), (12, 16), (5, 7), (26, 33), (1, 3)])
def test_each_pixel_has_the_mean_light_of_its_area(
    size: tuple[int, int], shape: tuple[int, int]
) -> None:
    light = np.random.default_rng(0).random(size).astype(np.float32)
    found = area_mean(light, shape)
    assert found.dtype == np.float32
    assert found.shape == shape
    # sums of at most 40 float32 terms of one sign, twice
    np.testing.assert_allclose(found, mean_of_areas(light, shape), rtol=80 * 2.0**-24)


def test_a_bright_spot_leaves_no_trace_beside_its_area() -> None:
    light = np.ones((13, 31), np.float32)
    light[6, 15] = 1e9
    found = area_mean(light, (5, 7))
    assert np.count_nonzero(found > 2) == 1
    np.testing.assert_allclose(np.delete(found.ravel(), found.argmax()), 1.0, rtol=1e-6)


def test_a_pixel_without_light_stays_where_it_is() -> None:
    light = np.ones((12, 16), np.float32)
    light[4, 6] = np.nan
    found = area_mean(light, (6, 8))
    assert np.argwhere(np.isnan(found)).tolist() == [[2, 3]]


def test_light_of_the_right_size_is_not_touched() -> None:
    light = np.random.default_rng(0).random((6, 8)).astype(np.float32)
    assert area_mean(light, (6, 8)) is light


@pytest.mark.parametrize(
    ("frame", "sensor", "fit", "crop", "box"),
    [
        ((300, 400), (260, 346), "crop", None, (0, 0, 399, 300)),
        ((480, 640), (260, 346), "crop", None, (0, 0, 639, 480)),
        ((720, 1280), (480, 640), "crop", None, (160, 0, 960, 720)),
        ((1280, 720), (480, 640), "crop", None, (0, 370, 720, 540)),
        ((720, 1280), (480, 640), "stretch", None, (0, 0, 1280, 720)),
        ((720, 1280), (480, 640), "crop", (100, 20, 64, 96), (100, 44, 64, 48)),
        ((720, 1280), (480, 640), "exact", (1, 2, 640, 480), (1, 2, 640, 480)),
    ],
)
def test_the_part_that_the_sensor_sees(frame, sensor, fit, crop, box) -> None:
    assert region(frame, sensor, fit, crop) == box


def test_a_part_that_cannot_be_is_refused_with_the_fix() -> None:
    for crop in ((0, 0, 1281, 720), (-1, 0, 5, 5), (0, 0, 0, 5)):
        with pytest.raises(EvsError, match="does not lie on the 1280 x 720 frames"):
            region((720, 1280), (480, 640), "crop", crop)
    with pytest.raises(EvsError, match=r"sensor\.width=1280 sensor\.height=720"):
        region((720, 1280), (480, 640), "exact", None)


@pytest.mark.parametrize("steps", [1, 2, 8, 64])
def test_straight_lines_in_log_and_in_linear_light(steps: int) -> None:
    random = np.random.default_rng(3)
    before, after = (np.exp(3 * random.standard_normal((5, 6))).astype(np.float32) for _ in "ab")
    before[0, 0] = after[1, 1] = 0.0
    floor = 1e-3
    share = np.arange(1, steps + 1)[:, None, None] / steps
    log = (np.float64(before) + floor) ** (1 - share) * (np.float64(after) + floor) ** share - floor
    found = np.stack(list(between(before, after, steps, "log", floor)))
    np.testing.assert_allclose(found, log, rtol=1e-6, atol=1e-9)
    linear = np.float64(before) * (1 - share) + np.float64(after) * share
    found = np.stack(list(between(before, after, steps, "linear", floor)))
    np.testing.assert_allclose(found, linear, rtol=1e-6)
    assert found[-1].tobytes() == after.tobytes()


def test_names_are_in_natural_order() -> None:
    names = ["frame_10.png", "frame_2.png", "frame_1b.png", "Frame_1.png"]
    assert sorted(names, key=natural_order) == [
        *("Frame_1.png", "frame_1b.png", "frame_2.png", "frame_10.png"),
    ]
