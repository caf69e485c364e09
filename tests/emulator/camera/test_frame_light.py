"""The numbers of a frame into light: every unit, every dtype, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.camera.frame_light import LUMA, UNITS, FrameLight, srgb_to_linear
from evs.emulator.config import SensorConfig
from evs.emulator.sensor import resolve_sensor
from evs.msgs import EvsError
from reference.closed_forms import linear

SHAPE = (3, 5)
SENSOR = resolve_sensor(SensorConfig(preset="davis346", exposure_dn=400.0))


def light(frame: Any, unit: str = "auto") -> Any:
    return np.array(FrameLight(SHAPE, unit, SENSOR).convert(frame))


def test_srgb_is_the_standards_to_the_last_bits() -> None:
    coded = np.linspace(0.0, 1.0, 100_001)
    assert np.abs(srgb_to_linear(coded) - linear(coded)).max() < 4e-16
    assert srgb_to_linear(np.array([1.5, -0.2])).tolist() == [1.0, -0.2 / 12.92]
    assert np.isnan(srgb_to_linear(np.array([np.nan])))


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32, np.float64])
def test_every_unit_of_every_dtype(unit: str, dtype: Any) -> None:
    whole = np.issubdtype(dtype, np.integer)
    white = float(np.iinfo(dtype).max) if whole else 255.0 if unit == "dn" else 1.0
    frame = np.linspace(0.1, 0.9, 15).reshape(SHAPE) * white
    frame = frame.astype(dtype)
    value = frame.astype(np.float64)
    meant = unit if unit != "auto" else ("srgb" if whole else "luminance")
    expected = {
        "luminance": value / white,
        "srgb": linear(value / white),
        "dn": value / 400.0,
        "lux": value / (SENSOR.white_lux / 255.0) / 400.0,
    }[meant]
    found = light(frame, unit)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=3e-7)


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_colours_are_weighed_in_linear_light(dtype: Any, channels: int) -> None:
    whole = np.issubdtype(dtype, np.integer)
    white = np.iinfo(dtype).max if whole else 1.0
    random = np.random.default_rng(0)
    frame = (random.random((*SHAPE, channels)) * white).astype(dtype)
    values = linear(frame / white) if whole else frame.astype(np.float64)
    expected = values[..., :3] @ (0.2126, 0.7152, 0.0722)
    np.testing.assert_allclose(light(frame), expected, rtol=1e-6)


def test_grey_of_three_equal_channels_is_the_grey() -> None:
    grey = np.arange(15, dtype=np.uint8).reshape(SHAPE) * 17
    colour = np.repeat(grey[..., None], 3, axis=2)
    np.testing.assert_allclose(light(colour), light(grey), rtol=2e-7)
    assert light(grey[..., None]).tobytes() == light(grey).tobytes()


def test_views_of_any_strides_are_read() -> None:
    frame = np.random.default_rng(1).random((*SHAPE, 3)).astype(np.float32)
    copy = np.ascontiguousarray(frame[::-1, :, ::-1])
    assert light(frame[::-1, :, ::-1]).tobytes() == light(copy).tobytes()


def strided(array: Any) -> dict[str, Any]:
    """The same numbers, differently laid out in memory."""
    packed = np.zeros(array.nbytes + 1, np.uint8)
    odd = packed[1:].view(array.dtype).reshape(array.shape)
    odd[:] = array
    frozen = array.copy()
    frozen.setflags(write=False)
    return {
        "turned": np.ascontiguousarray(array[::-1, ::-1])[::-1, ::-1],
        "apart": np.repeat(np.repeat(array, 2, 0), 3, 1)[::2, ::3],
        "by columns": np.asfortranarray(array),
        "not aligned": odd,
        "read-only": frozen,
    }


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("unit", ["srgb", "luminance", "dn", "lux"])
def test_looking_up_is_the_sum_of_three_tables_to_the_last_bit(dtype: Any, unit: str) -> None:
    numbers = np.random.default_rng(2).integers(0, np.iinfo(dtype).max + 1, (3, 5, 4)).astype(dtype)
    numbers[0, :2, :3] = [[0], [np.iinfo(dtype).max]]
    grey = light(numbers[:, :, 0], unit)
    # each channel's light is its grey, weighed and rounded
    r, g, b = (light(numbers[:, :, k], unit) * weight for k, weight in enumerate(LUMA))
    assert light(numbers, unit).tobytes() == ((r + g) + b).tobytes()
    shown = np.broadcast_to(numbers[:, :, :1], (3, 5, 3))
    assert light(shown, unit).tobytes() == light(shown.copy(), unit).tobytes()
    for name, view in strided(numbers).items():
        assert light(view, unit).tobytes() == ((r + g) + b).tobytes(), name
        assert light(view[:, :, 0], unit).tobytes() == grey.tobytes(), name


def test_the_core_refuses_what_does_not_fit() -> None:
    frame, tables = np.zeros(SHAPE, np.uint8), np.zeros((1, 256), np.float32)
    out = np.zeros(SHAPE, np.float32)
    _core.light_of_numbers(frame, tables, out)
    for numbers, given, target in [
        (frame, tables[:, :255].copy(), out),
        (frame.astype(np.uint16), tables, out),
        (frame.astype(np.int8), tables, out),
        (frame, tables, out[1:].copy()),
        (np.zeros((*SHAPE, 3), np.uint8), tables, out),
        (np.zeros((*SHAPE, 2), np.uint8), np.zeros((3, 256), np.float32), out),
        (np.zeros(5, np.uint8), tables, out),
    ]:
        with pytest.raises(ValueError, match=r"ha(s|ve) to"):
            _core.light_of_numbers(numbers, given, target)


@pytest.mark.parametrize("dtype", [">u2", ">f4", "<u2", "<f8"])
def test_the_order_of_bytes_makes_no_difference(dtype: str) -> None:
    frame = np.linspace(0.1, 0.9, 15).reshape(SHAPE) * (60_000 if "u" in dtype else 1)
    frame = frame.astype(dtype)
    native = frame.astype(frame.dtype.newbyteorder("="))
    assert light(frame).tobytes() == light(native).tobytes()


def test_what_is_no_light_stays_for_the_pixels_to_count() -> None:
    frame = np.ones(SHAPE)
    frame[0, :3] = np.nan, -1.0, np.inf
    found = light(frame)
    assert np.isnan(found[0, 0])
    assert found[0, 1:3].tolist() == [-1.0, np.inf]


class Tensor:
    """Another library's array: DLPack and nothing else."""

    def __init__(self, array: Any, device: int = 1) -> None:
        self._array, self._device = array, device

    def __dlpack__(self, **options: Any) -> Any:
        return self._array.__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        return self._device, 0


class Training(Tensor):
    """One that needs a gradient, as PyTorch refuses it."""

    def __dlpack__(self, **options: Any) -> Any:
        raise BufferError("Can't export tensors that require gradient, use tensor.detach()")


def test_arrays_of_other_libraries_are_read_by_dlpack() -> None:
    frame = np.random.default_rng(2).random(SHAPE).astype(np.float32)
    assert light(Tensor(frame)).tobytes() == light(frame).tobytes()


@pytest.mark.parametrize(
    ("frame", "says"),
    [
        (np.zeros((3, 4)), r"frame is \(3, 4\).*3 x 5.*size="),
        (np.zeros((5, 3)), r"frame is \(5, 3\)"),
        (np.zeros((*SHAPE, 2)), r"\(3, 5, 2\)"),
        (np.zeros((1, *SHAPE)), r"\(1, 3, 5\)"),
        (np.zeros(SHAPE, np.int32), "dtype int32; give uint8, uint16 or a float"),
        (np.zeros(SHAPE, bool), "dtype bool"),
        (np.zeros(SHAPE, complex), "dtype complex128"),
        ("frame.png", "frame is"),
        (None, "frame is"),
        (Tensor(np.zeros(SHAPE, np.float32), 2), r"another device.*tensor\.cpu\(\)"),
        (Training(np.zeros(SHAPE, np.float32)), "require gradient"),
    ],
)
def test_what_is_no_frame_is_refused_in_one_line(frame: Any, says: str) -> None:
    with pytest.raises(EvsError, match=says) as caught:
        light(frame)
    assert "\n" not in str(caught.value)


def test_an_unknown_unit_lists_those_that_there_are() -> None:
    with pytest.raises(EvsError, match="no unit of frames 'nits'; there is: "):
        FrameLight(SHAPE, "nits", SENSOR)
