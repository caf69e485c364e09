"""Event frames pixel by pixel, the tone curve, and the colours for every kind of eye."""

import numpy as np
import pytest

from evs.drivers.pictures import count_polarities, events_between, upscale
from evs.drivers.pictures.frame import whole_factor
from evs.msgs import EvsError, empty_events, make_events
from evs.msgs.pictures import OFF_RGB, ON_RGB, SteadyExposure, event_frame, exposure_for, to_srgb8


def test_an_on_event_colours_exactly_its_pixel() -> None:
    frame = event_frame(make_events([5], [2], [1], [1]), 4, 3)
    wanted = np.full((3, 4, 3), 255, np.uint8)
    wanted[1, 2] = ON_RGB
    np.testing.assert_array_equal(frame, wanted)


def test_an_off_event_in_the_far_corner_over_grey() -> None:
    background = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20
    frame = event_frame(make_events([5], [3], [2], [0]), 4, 3, background)
    assert tuple(frame[2, 3]) == OFF_RGB
    # every other pixel is the background in all three channels
    rest = np.ones((3, 4), bool)
    rest[2, 3] = False
    for channel in range(3):
        np.testing.assert_array_equal(frame[:, :, channel][rest], background[rest])


def test_the_last_event_of_a_pixel_wins() -> None:
    events = make_events([1, 2, 3, 4], [0, 0, 1, 1], [0, 0, 0, 0], [0, 1, 1, 0])
    frame = event_frame(events, 2, 1)
    assert tuple(frame[0, 0]) == ON_RGB
    assert tuple(frame[0, 1]) == OFF_RGB


def test_the_background_is_not_written_to() -> None:
    background = np.zeros((1, 1), np.uint8)
    event_frame(make_events([1], [0], [0], [1]), 1, 1, background)
    assert background[0, 0] == 0


def test_window_is_open_at_its_begin_and_closed_at_its_end() -> None:
    events = make_events([10, 20, 20, 30, 31], range(5), [0] * 5, [1] * 5)
    assert events_between(events, 10, 30)["x"].tolist() == [1, 2, 3]
    assert len(events_between(events, 31, 99)) == 0
    assert len(events_between(empty_events(), 0, 10)) == 0


def test_polarities_are_counted() -> None:
    assert count_polarities(make_events([1, 2, 3], [0] * 3, [0] * 3, [1, 0, 0])) == (1, 2)
    assert count_polarities(empty_events()) == (0, 0)


@pytest.mark.parametrize(("x", "y"), [(4, 0), (0, 3), (-1, 0), (0, -1)])
def test_an_event_outside_the_sensor_is_refused(x: int, y: int) -> None:
    with pytest.raises(EvsError, match=rf"event at \({x}, {y}\) is outside .* 4 x 3"):
        event_frame(make_events([1, 2], [0, x], [0, y], [1, 1]), 4, 3)


def test_a_background_of_another_size_is_refused() -> None:
    with pytest.raises(EvsError, match="background is 3 x 4, not 4 x 3"):
        event_frame(empty_events(), 4, 3, np.zeros((4, 3), np.uint8))


def test_upscale_repeats_whole_pixels() -> None:
    picture = np.array([[1, 2], [3, 4]], np.uint8)
    np.testing.assert_array_equal(
        upscale(picture, 2), [[1, 1, 2, 2], [1, 1, 2, 2], [3, 3, 4, 4], [3, 3, 4, 4]]
    )


@pytest.mark.parametrize(
    ("width", "height", "factor"), [(1, 1, 480), (346, 260, 2), (480, 1, 1), (1280, 720, 1)]
)
def test_small_sensors_are_enlarged(width: int, height: int, factor: int) -> None:
    assert whole_factor(width, height, 480) == factor


def test_srgb_of_known_light() -> None:
    # 0.2140 linear is 50 % and 0.0033 is 4 % display value on the sRGB curve
    light = np.array([[0.0, 0.21404114, 1.0, 2.0, 0.001]], np.float32)
    assert to_srgb8(light, 1.0).tolist() == [[0, 128, 255, 255, 3]]


def test_exposure_scales_linear_light() -> None:
    light = np.array([[0.1, 0.2]], np.float32)
    np.testing.assert_array_equal(to_srgb8(light, 2.0), to_srgb8(light * 2, 1.0))


def test_not_a_number_is_black_and_infinite_is_white() -> None:
    light = np.array([[np.nan, np.inf, -np.inf, -1.0, 3e38]], np.float32)
    assert to_srgb8(light, 1e30).tolist() == [[0, 255, 0, 0, 255]]


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_exposure_does_not_depend_on_the_unit_of_light(unit: float) -> None:
    light = (np.linspace(0, 1, 1000, dtype=np.float32) * np.float32(unit)).reshape(10, 100)
    shown = to_srgb8(light, exposure_for(light))
    # 99 % of the pixels at or under 0.8 of full light, which is 231 on the sRGB curve
    assert np.quantile(shown, 0.99) == pytest.approx(231, abs=1)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, -1.0])
def test_exposure_of_a_picture_without_light_is_one(value: float) -> None:
    assert exposure_for(np.full((2, 2), value, np.float32)) == 1.0


# Machado, Oliveira and Fernandes 2009, severity 1.0; they act on linear RGB
BLINDNESS = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
    "none": np.eye(3).tolist(),
}


def _lab(rgb: tuple[int, int, int], matrix: list[list[float]]) -> np.ndarray:
    """CIE L*a*b* (D65) of an sRGB colour as an eye with this deficiency sees it."""
    coded = np.array(rgb) / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(matrix) @ linear, 0, 1)
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    ratio = to_xyz @ seen / (to_xyz @ np.ones(3))
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("eye", sorted(BLINDNESS))
def test_polarities_are_told_apart_by_every_eye(eye: str) -> None:
    on, off = _lab(ON_RGB, BLINDNESS[eye]), _lab(OFF_RGB, BLINDNESS[eye])
    # a difference of 10 is plain at a glance; small dots need several times that
    assert np.linalg.norm(on - off) > 60


@pytest.mark.parametrize("eye", sorted(BLINDNESS))
@pytest.mark.parametrize("colour", [ON_RGB, OFF_RGB])
def test_both_polarities_stand_out_from_every_grey(eye: str, colour: tuple[int, int, int]) -> None:
    dot = _lab(colour, BLINDNESS[eye])
    nearest = min(
        float(np.linalg.norm(dot - _lab((grey,) * 3, BLINDNESS[eye]))) for grey in range(256)
    )
    assert nearest > 25


def test_one_exposure_holds_for_a_stream() -> None:
    exposure = SteadyExposure()
    black, dim = np.zeros((4, 4), np.float32), np.full((4, 4), 1e-3, np.float32)
    assert exposure.code(black).max() == 0
    # whatever was black before
    shown = exposure.code(dim)
    assert (shown == to_srgb8(dim, exposure_for(dim))).all()
    bright = exposure.code(4 * dim)
    assert (bright == shown).all()
    # darker than at first, and it stays so
    assert (exposure.code(dim) < shown).all()
    assert (exposure.code(black) == 0).all()
