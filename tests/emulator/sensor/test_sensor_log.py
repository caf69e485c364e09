"""The logarithm and the log maps: error, monotony, and the same bits as the NumPy oracle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.pixel import log_light
from evs.emulator.sensor.reference import light

F = np.float32


def from_bits(first: int, last: int, step: int = 1) -> F32:
    return np.arange(first, last, step, dtype=np.int64).astype(np.int32).view(np.float32)


ALL_MAGNITUDES = (0x00800000, 0x7F800000, 4001)
AROUND_ONE = (0x3F000000, 0x40000000, 3)
"""0.5 ... 2, every third float: where ln changes sign and cancellation is worst."""


def test_ln_of_one_is_exactly_zero() -> None:
    assert _core.natural_log(np.ones(1, F)).tobytes() == np.zeros(1, F).tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("bits", [ALL_MAGNITUDES, AROUND_ONE], ids=["all", "one"])
def test_ln_is_within_one_ulp(bits: tuple[int, int, int]) -> None:
    values = from_bits(*bits)
    exact = np.log(values.astype(np.float64))
    ulp = np.spacing(np.abs(exact).astype(F)).astype(np.float64)
    error = np.abs(_core.natural_log(values) - exact)
    assert np.max(error[exact != 0] / ulp[exact != 0]) < 0.86


@pytest.mark.parametrize(
    "bits",
    [
        ALL_MAGNITUDES,
        (0x3F000000, 0x40000000),
        # around every change of exponent and of the reduced interval
        *((0x3F3504F3 + (e << 23) - 3000, 0x3F3504F3 + (e << 23) + 3000) for e in (-9, 7)),
        *((0x3F800000 + (e << 23) - 3000, 0x3F800000 + (e << 23) + 3000) for e in (-9, 7)),
    ],
)
def test_ln_never_decreases(bits: tuple[int, ...]) -> None:
    assert np.all(np.diff(_core.natural_log(from_bits(*bits))) >= 0)


@pytest.mark.parametrize("bits", [ALL_MAGNITUDES, AROUND_ONE], ids=["all", "one"])
def test_ln_has_the_oracles_bits(bits: tuple[int, int, int]) -> None:
    values = from_bits(*bits)
    assert _core.natural_log(values).tobytes() == light.natural_log(values).tobytes()


def sensor(**given: float | str) -> SensorParameters:
    return SensorParameters("test", 4, 4, 0.2, 0.2, **given)  # type: ignore[arg-type]


MAPS = [
    sensor(),
    sensor(linlog_dn=20.0, exposure_dn=1.0),
    sensor(linlog_dn=1.001, dark_lux=0.3 * 1000 / 255),
    sensor(log="log_eps"),
    sensor(log="log_eps", log_eps=1e-6, exposure_dn=1e4, dark_lux=2000 / 255),
    sensor(log="ln", dark_lux=0.1),
    sensor(log="ln", dark_lux=1e-9, exposure_dn=1e-3),
    sensor(log="ln", dark_lux=5.0, exposure_dn=1e4),
]


def exact_map(luminance: F32, pixel: SensorParameters) -> np.ndarray:
    dn = luminance.astype(np.float64) * pixel.exposure_dn + pixel.dark_dn
    if pixel.log == "log_eps":
        return np.asarray(np.log(dn / 255 + pixel.log_eps))
    if pixel.log == "ln":
        return np.asarray(np.log(dn))
    rho = pixel.linlog_dn
    return np.where(dn >= rho, np.log(np.maximum(dn, rho)), math.log(rho) / rho * dn)


@pytest.mark.parametrize("pixel", MAPS)
def test_maps_are_the_formulas(pixel: SensorParameters) -> None:
    luminance = np.concatenate([np.zeros(1, F), np.geomspace(1e-6, 1e6, 20001).astype(F)])
    exact = exact_map(luminance, pixel)
    # rounding of DN (relative 2^-23 in log light) and of the result
    assert np.all(np.abs(log_light(luminance, pixel) - exact) < 4e-7 + 2e-7 * np.abs(exact))


@pytest.mark.parametrize("pixel", MAPS)
def test_maps_never_decrease_not_even_across_the_knee(pixel: SensorParameters) -> None:
    knee = max(pixel.linlog_dn - pixel.dark_dn, 1.0) / pixel.exposure_dn
    at = int(np.array([knee], F).view(np.int32)[0])
    assert np.all(np.diff(log_light(from_bits(at - 200_000, at + 200_000), pixel)) >= 0)


def test_default_map_is_continuous_and_smooth_at_its_knee() -> None:
    at = math.e / 255
    below, knee, above = log_light(np.array([at * 0.999, at, at * 1.001], F), sensor())
    assert knee == pytest.approx(1.0, abs=2e-7)
    assert knee - below == pytest.approx(above - knee, rel=2e-3)


@pytest.mark.parametrize("pixel", MAPS)
def test_maps_have_the_oracles_bits(pixel: SensorParameters) -> None:
    generator = np.random.default_rng(1)
    luminance = np.exp(generator.uniform(-86, 86, 50_000)).astype(F)
    luminance[::7] *= -1
    luminance[:6] = [0.0, -0.0, np.nan, np.inf, -np.inf, 3.4e38]
    ours, oracle = log_light(luminance, pixel), light.log_light(luminance, pixel)
    assert ours.tobytes() == oracle.tobytes()


def test_ln_sees_a_ratio_alike_at_every_light_above_the_dark_current() -> None:
    """A step by 4 at 1000 ... 1 lux; linlog's knee at 10.7 lux halves it at 3 lux."""
    lux = np.array([1000.0, 100.0, 10.0, 3.0, 1.0])
    light = (lux / 1000.0).astype(F)
    physical, knee = sensor(log="ln", dark_lux=0.01), sensor(dark_lux=0.01)
    step = log_light(F(4) * light, physical) - log_light(light, physical)
    # the dark current takes its share: ln((4 E + d) / (E + d))
    assert step == pytest.approx(np.log((4 * lux + 0.01) / (lux + 0.01)), abs=2e-6)
    assert step.min() > 0.99 * math.log(4)
    linear = log_light(F(4) * light, knee) - log_light(light, knee)
    assert linear[3] < 0.65 * math.log(4)
    assert linear[4] < 0.25 * math.log(4)


def test_the_dark_current_alone_is_the_floor_of_ln() -> None:
    pixel = sensor(log="ln", dark_lux=0.1)
    black = log_light(np.zeros(1, F), pixel)
    assert black[0] == pytest.approx(math.log(0.1 * 255 / 1000), rel=1e-6)


def test_what_is_no_light_is_nan_and_what_is_tiny_is_black() -> None:
    luminance = np.array([[np.nan, np.inf, -1.0, -1e-18], [-1e-20, 1e-20, 1e-42, -0.0]], F)
    mapped = log_light(luminance, sensor(dark_lux=1000 / 255))
    assert np.all(np.isnan(mapped[0]))
    assert mapped[1] == pytest.approx(1 / math.e, rel=1e-6)
    assert np.all(mapped[1] == mapped[1, 0])
