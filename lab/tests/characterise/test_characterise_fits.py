"""The bench's fits, laws and words, against closed forms and other people's functions."""

from __future__ import annotations

import dataclasses
import math

import matplotlib as mpl
import numpy as np
import pytest
from scipy import optimize, stats

from evs.drivers.pictures.chart import Chart, Scale, Series, decades_around, draw_charts
from evs.emulator.config import SensorConfig
from evs.emulator.sensor import SensorParameters, resolve_sensor
from evs_lab.characterise import expected
from evs_lab.characterise.background import Spreads, leak_without_noise, mean_excess
from evs_lab.characterise.bench import Bench, corner
from evs_lab.characterise.fit import crossing, fit_normal, mean_and_error
from evs_lab.characterise.quantity import Quantity, table_rows

SENSOR = SensorParameters("s", 20, 10, 0.2, 0.2, 0.02, cutoff_hz=300.0, follower_hz=900.0)

LATENCY_US = {"davis346": 20, "davis240": 12, "dvxplorer": 50, "imx636": 100, "genx320": 150}
"""of a step of 100 % at 1 klux, as the files state"""


@pytest.mark.parametrize("steps", [4, 9, 30])
def test_grouped_normal_is_the_likeliest_one(steps: int) -> None:
    values = np.random.default_rng(steps).normal(0.2, 0.03, 5000)
    edges = np.linspace(0.12, 0.27, steps)
    counts = np.histogram(values, np.concatenate(([-9.0], edges, [9.0])))[0].astype(np.float64)
    fit = fit_normal(edges, counts)

    def cost(at: np.ndarray) -> float:
        shares = np.diff(np.concatenate(([0.0], stats.norm.cdf(edges, *at), [1.0])))
        return -float(counts @ np.log(shares))

    best = optimize.minimize(cost, [0.21, 0.02], method="Nelder-Mead", tol=1e-9).x
    assert abs(fit.mean - best[0]) < 1e-6
    assert abs(fit.sigma - best[1]) < 1e-6
    assert abs(fit.mean - 0.2) < 4.0 * fit.mean_error
    assert abs(fit.sigma - 0.03) < 4.0 * fit.sigma_error
    # grouping can only lose: the errors are over those of the values themselves
    assert fit.mean_error > 0.03 / math.sqrt(5000) * 0.99
    assert fit.sigma_error > 0.03 / math.sqrt(10_000) * 0.99


def test_errors_of_the_grouped_normal_are_those_of_repetition() -> None:
    edges = np.linspace(-3.0, 3.0, 13)
    generator = np.random.default_rng(5)
    bins = np.concatenate(([-99.0], edges, [99.0]))
    fits = [
        fit_normal(edges, np.histogram(generator.normal(size=400), bins)[0].astype(np.float64))
        for _ in range(400)
    ]
    for value, error in (("mean", "mean_error"), ("sigma", "sigma_error")):
        seen = np.std([getattr(fit, value) for fit in fits], ddof=1)
        said = np.mean([getattr(fit, error) for fit in fits])
        # a standard deviation of 400 values is known to 1 / sqrt(800)
        assert abs(seen / said - 1.0) < 4.5 / math.sqrt(800)


@pytest.mark.parametrize("counts", [[0, 7, 0, 0], [0, 3, 4, 0], [7, 0, 0, 0], [0, 0, 0, 7]])
def test_counts_in_one_place_have_no_spread(counts: list[int]) -> None:
    fit = fit_normal(np.array([1.0, 2.0, 3.0]), np.array(counts, np.float64))
    assert 1.0 <= fit.mean <= 3.0
    assert fit.sigma == 0.0
    assert fit.mean_error <= 2.0 / math.sqrt(12.0)


def test_no_counts_no_numbers() -> None:
    assert math.isnan(fit_normal(np.array([1.0, 2.0]), np.zeros(3)).mean)
    assert math.isnan(mean_and_error(np.zeros(1))[0])
    assert math.isnan(crossing(np.arange(3.0), np.zeros(3), 1.0))


def test_half_power_of_two_poles() -> None:
    for lux in (0.0, 30.0, 1000.0, 5e4):
        f = expected.half_power_hz(SENSOR, lux)
        power = 1.0
        for pole in (expected.pole_hz(SENSOR, lux), SENSOR.follower_hz):
            power /= 1.0 + (f / pole) ** 2
        assert abs(power - 0.5) < 1e-12
    assert expected.pole_hz(SENSOR, SENSOR.bright_lux) == 300.0
    one = dataclasses.replace(SENSOR, follower_hz=0.0)
    assert expected.half_power_hz(one, 1000.0) == 300.0
    assert math.isinf(expected.half_power_hz(dataclasses.replace(one, cutoff_hz=0.0), 1.0))


def test_step_time_of_the_large_signal_photoreceptor_is_that_of_its_equation() -> None:
    """Its closed form alone, Euler steps of a thousandth with the follower; small steps: linear."""
    large = dataclasses.replace(SENSOR, filter="large_signal")
    alone = dataclasses.replace(large, follower_hz=0.0)
    one, two = expected.time_constants_s(large, 100.0)
    for share in (0.1, 0.5, 0.9):
        for step in (0.7, 3.0):
            left = math.expm1((1.0 - share) * step) / math.expm1(step)
            t = expected.step_time_s(alone, 100.0, share, step)
            assert math.isclose(t, -one * math.log(left), rel_tol=1e-9)
            t, dt = 0.0, 1e-4 * min(one, two)
            y = f = 0.0
            while f < share * step:
                f += dt / two * (y - f)
                y += dt / one * (1.0 - math.exp(y - step))
                t += dt
            assert math.isclose(expected.step_time_s(large, 100.0, share, step), t, rel_tol=1e-3)
        linear = expected.step_time_s(SENSOR, 100.0, share)
        assert math.isclose(expected.step_time_s(large, 100.0, share, 1e-4), linear, rel_tol=1e-4)


def test_step_time_of_two_poles_is_that_of_the_equation() -> None:
    one, two = expected.time_constants_s(SENSOR, 100.0)
    for share in (0.1, 0.5, 0.9):
        t = expected.step_time_s(SENSOR, 100.0, share)
        through = 1.0 - (one * math.exp(-t / one) - two * math.exp(-t / two)) / (one - two)
        assert abs(through - share) < 1e-9
    single = dataclasses.replace(SENSOR, follower_hz=0.0)
    assert math.isclose(expected.step_time_s(single, 100.0, 1.0 - math.exp(-1.0)), one)
    assert math.isinf(expected.step_time_s(single, 100.0, 1.0))
    equal = dataclasses.replace(SENSOR, follower_hz=expected.pole_hz(SENSOR, 100.0))
    x = expected.step_time_s(equal, 100.0, 0.5) / one
    # two equal poles: 1 - (1 + x) e^-x
    assert abs(1.0 - (1.0 + x) * math.exp(-x) - 0.5) < 1e-5


def test_least_light_is_where_the_step_is_a_threshold() -> None:
    lux = expected.lowest_lux(SENSOR, 1e-3, 1e5)
    assert abs(expected.log_step(SENSOR, lux, expected.CONTRAST * lux) - 0.2) < 1e-6
    deaf = dataclasses.replace(SENSOR, pos_thres=0.6)
    assert math.isnan(expected.lowest_lux(deaf, 1e-3, 1e5))


def test_leak_behind_noise_by_simulation() -> None:
    """A pixel that leaks after 1 / L of silence: its events, counted one by one."""
    generator = np.random.default_rng(8)
    n, spreads = 40_000, Spreads(0.3, 0.4)
    for leak, shot in ((1.0, 0.3), (1.0, 1.0), (1.0, 2.5)):
        leaks = leak * np.exp(spreads.leak * generator.normal(size=n) - 0.5 * spreads.leak**2)
        shots = shot * np.exp(spreads.shot * generator.normal(size=n) - 0.5 * spreads.shot**2)
        waits = generator.exponential(1.0 / shots, (200, n))
        # each silence has as many leak events as whole leak times fit in it
        rate = np.floor(waits * leaks).sum(0) / waits.sum(0)
        d, error = mean_and_error(rate)
        assert abs(mean_excess(leak, shot, spreads) - d) < 4.5 * error + 2e-3 * d
        found, _ = leak_without_noise((d, error), (shot, 0.0), spreads)
        assert abs(found - leak) < 0.02


def test_leak_lost_in_noise_has_no_number() -> None:
    none = Spreads(0.0, 0.0)
    assert math.isnan(leak_without_noise((0.01, 0.01), (1.0, 0.01), none)[0])
    assert math.isnan(leak_without_noise((0.001, 1e-5), (1.0, 0.01), none)[0])
    assert leak_without_noise((0.2, 0.01), (0.0, 0.0), none) == (0.2, 0.01)


def test_rows_have_the_digits_that_their_errors_have() -> None:
    rows = table_rows(
        [
            Quantity("latency", "s", 0.00123456, 2.1e-6, 0.0012, 100.0),
            Quantity("latency", "s", math.nan, math.nan, 0.0012, 1.0, "too dark"),
            Quantity("bandwidth", "Hz", 1863.8, 4.4, 1865.0, 1e4),
            Quantity("dead pixels", "", 0.0, 0.0, 0.0),
        ]
    )
    assert rows[0] == ("latency", "100", "1.2346 ms", "0.0021", "1.2000 ms", "+2.88 %", "")
    assert rows[1] == ("", "1", "-", "", "1.200 ms", "", "too dark")
    assert rows[2] == ("bandwidth", "10000", "1.8638 kHz", "0.0044", "1.8650 kHz", "-0.06 %", "")
    assert rows[3] == ("dead pixels", "-", "0", "0", "0", "", "")


def test_a_corner_is_that_of_the_whole() -> None:
    wide = dataclasses.replace(SENSOR, width=1280, height=720)
    part = corner(wide, 40_000)
    assert 39_000 < part.width * part.height <= 40_000
    assert abs(part.width / part.height - 16 / 9) < 0.02
    assert corner(SENSOR, 200) is SENSOR
    slim = corner(dataclasses.replace(SENSOR, width=1, height=8000), 100)
    assert (slim.width, slim.height) == (1, 100)


def test_the_lamp_gives_the_illuminance_that_the_sensor_has() -> None:
    sensor = dataclasses.replace(SENSOR, white_lux=500.0, exposure_dn=100.0)
    # DN = exposure luminance, and 255 of them are white_lux
    light = Bench(sensor, threads=1).luminance(500.0)
    assert np.allclose(light * sensor.exposure_dn, 255.0)


def test_decades_around() -> None:
    assert decades_around([0.3, 20.0]) == (0.1, 100.0)
    assert decades_around([10.0]) == (10.0, 100.0)
    assert decades_around([0.0, math.nan, math.inf]) == (0.1, 10.0)


RED = (200, 0, 0)


def red_pixels(*series: Series) -> tuple[np.ndarray, np.ndarray]:
    scale = Scale(1.0, 100.0, log=True)
    picture = draw_charts([Chart("t", scale, scale, "x", series)], 1, (400, 300)).astype(int)
    assert picture.shape == (300, 400, 3)
    return np.nonzero(picture[:, :, 0] - picture[:, :, 1] > 150)


def test_a_point_stands_where_its_value_is() -> None:
    # near two corners of the axes, and in their middle
    (low_y, low_x), (high_y, high_x) = (red_pixels(Series([v], [v], RED)) for v in (2.0, 50.0))
    y, x = red_pixels(Series([10.0], [10.0], RED))
    assert abs(x.mean() - (low_x.mean() + high_x.mean()) / 2) < 1.0
    assert abs(y.mean() - (low_y.mean() + high_y.mean()) / 2) < 1.0


def test_what_has_no_place_is_left_out() -> None:
    bad = Series([0.0, -1.0, math.nan, 5.0, 5.0], [5.0, 5.0, 5.0, math.inf, 0.0], RED)
    assert not len(red_pixels(bad, dataclasses.replace(bad, line=True))[0])


def test_a_users_style_changes_no_picture() -> None:
    chart = Chart("t", Scale(0.0, 1.0), Scale(0.0, 1.0), "x", [Series([0.5], [0.5], RED, "a")])
    plain = draw_charts([chart], 1, (400, 300))
    with mpl.rc_context({"axes.facecolor": "black", "font.size": 20}):
        assert np.array_equal(draw_charts([chart], 1, (400, 300)), plain)


def latency_s(chip: SensorParameters, lux: float) -> float:
    """Of a step of 100 % to an illuminance, whose first event is that of the mean threshold."""
    return expected.step_time_s(chip, lux, chip.pos_thres / math.log(2.0), math.log(2.0))


@pytest.mark.parametrize("name", LATENCY_US)
def test_bandwidth_gives_the_latency_that_the_maker_states(name: str) -> None:
    """That of the DAVIS is the best of all biases; here the follower has those of libcaer."""
    chip = resolve_sensor(SensorConfig(name))
    if name.startswith("davis"):
        fast = dataclasses.replace(chip, follower_hz=0.0)
        assert latency_s(fast, 1000.0) < LATENCY_US[name] * 1e-6
    else:
        assert latency_s(chip, 1000.0) == pytest.approx(LATENCY_US[name] * 1e-6, rel=0.01)


def test_imx636_is_within_sonys_limit_in_dim_light() -> None:
    """1 ms at 5 lux."""
    assert latency_s(resolve_sensor(SensorConfig("imx636")), 5.0) < 1e-3
