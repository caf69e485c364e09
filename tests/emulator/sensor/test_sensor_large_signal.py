"""The large-signal photoreceptor: its equation, small signals, extremes, rest, oracle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.reference.filters import FADED, follow
from evs.msgs import Events
from reference.waves import MIDDLE, run

F = np.float32
LOWEST, HIGHEST = -28.0, 89.0
"""logs of the least dark current and of the strongest light that a sensor may have"""


def anything(count: int, seed: int) -> tuple[F32, F32, F32, F32]:
    """z, y0, x0, x1 over everything that a pixel may meet; a third of the light stands still."""
    rng = np.random.default_rng(seed)

    def moves() -> F64:
        return np.asarray(rng.normal(0, 1, count) * np.exp(rng.uniform(-14, 4.5, count)))

    z = np.exp(rng.uniform(-62, 69, count))
    x0 = rng.uniform(LOWEST, HIGHEST, count)
    x1 = np.clip(x0 + np.where(rng.random(count) < 0.3, 0, moves()), LOWEST, HIGHEST)
    y0 = np.where(rng.random(count) < 0.5, x0 + moves(), rng.uniform(LOWEST, HIGHEST, count))
    return z.astype(F), np.clip(y0, LOWEST, HIGHEST).astype(F), x0.astype(F), x1.astype(F)


def step(z: F32, y0: F32, x0: F32, x1: F32) -> F32:
    found: F32 = _core.large_signal_steps(z, y0, x0, x1)
    return found


def closed_form(z: F32, y0: F32, x0: F32, x1: F32) -> F64:
    """q1 = q0 e^-m + z (1 - e^-m) / m and y1 = x1 - ln q1, by logarithms in long double."""
    wide = np.longdouble
    z_, y, a, b = (v.astype(wide) for v in (z, y0, x0, x1))
    m = z_ - (b - a)
    size = np.maximum(np.abs(m), wide(1e-18))
    # (1 - e^-m) / m = e^(max(-m, 0)) (1 - e^-|m|) / |m|
    driven = np.log(z_ * -np.expm1(-size) / size) + np.maximum(-m, 0)
    return np.asarray(b - np.logaddexp((a - y) - m, driven), np.float64)


def test_a_step_is_the_closed_form_wherever_light_goes() -> None:
    args = anything(400_000, 1)
    _, y0, x0, x1 = args
    error = np.abs(step(*args) - closed_form(*args))
    # rounding of y (2^-24 of 89), and 1e-6 of what an exponential or a logarithm contributes
    assert error.max() < 2e-5
    # near rest it is as precise as the pole of filter="exact"
    near = (np.abs(x1 - y0) < 1) & (np.abs(x1 - x0) < 1)
    assert np.count_nonzero(near) > 50_000
    bound = np.spacing(np.abs(y0)) + 1e-6 * (np.abs(x1 - y0) + np.abs(x1 - x0)) + 3e-7
    assert np.all(error[near] < bound[near])


def test_it_has_the_oracles_bits() -> None:
    args = anything(400_000, 2)
    extremes = [0.0, 1e-38, 2.0**-90, 1e-30, 1.0, 80.0, 1e30, np.inf, np.nan]
    lights = [LOWEST, -1.0, 0.0, 1e-19, 1.0, HIGHEST]
    grid = np.array(np.meshgrid(extremes, lights, lights, lights), F).reshape(4, -1)
    for z, y0, x0, x1 in (args, tuple(np.ascontiguousarray(line) for line in grid)):
        expected = np.asarray(follow(z, y0, x0, x1, "large_signal"), F)
        ours = step(z, y0, x0, x1)
        assert np.isfinite(ours).all()
        # follow also makes 0 of what is closer to it than 2^-64
        assert ours.tobytes() == expected.tobytes()


def test_it_stays_between_its_light_and_where_it_was() -> None:
    """Light that stands still is approached and not passed, but for rounding."""
    z, y0, x0, _ = anything(200_000, 3)
    y1 = step(z, y0, x0, x0).astype(np.float64)
    low, high = np.minimum(x0, y0), np.maximum(x0, y0)
    assert np.all((y1 >= low - 2e-5) & (y1 <= high + 2e-5))
    # never faster into the light than w
    assert np.all(y1 - y0 <= z.astype(np.float64) * (1 + 1e-6) + 1e-5)


@pytest.mark.parametrize("z", [0.0, 1e-30, 1e-6, 0.01, 1.0, 30.0, 1e6, math.inf])
def test_a_settled_photoreceptor_stands_still(z: float) -> None:
    y = np.random.default_rng(1).uniform(LOWEST, HIGHEST, 10_000).astype(F)
    assert step(np.full_like(y, z), y, y, y).tobytes() == y.tobytes()


@pytest.mark.parametrize("z", [0.02, 0.3, 5.0, 1e4])
def test_still_light_is_reached_in_the_end_bit_for_bit(z: float) -> None:
    """The state comes to a fixed point from anywhere, so that blocks of pixels can be skipped."""
    rng = np.random.default_rng(2)
    x = rng.uniform(-4, 8, 4000).astype(F)
    y = (x + rng.normal(0, 2, 4000)).astype(F)
    each = np.full_like(x, z)
    for _ in range(round(60 + 60 / min(z, 1.0))):
        y = step(each, y, x, x)
    assert step(each, y, x, x).tobytes() == y.tobytes()
    # what is left is less than the last bit of y after a tick's share of it
    share = -math.expm1(-z)
    assert np.all(np.abs(x - y) <= np.spacing(np.abs(y)) / (2 * share) * 1.01)


@pytest.mark.parametrize("size", [1e-1, 1e-2, 1e-3])
def test_small_signals_pass_as_through_the_linear_pole(size: float) -> None:
    """The two differ by the square of the signal: y' = w (1 - e^-d) = w (d - d^2 / 2 + ...)."""
    rng = np.random.default_rng(3)
    count = 20_000
    z = np.exp(rng.uniform(-6, 3, count)).astype(F)
    x0 = rng.normal(0, 0.1, count).astype(F)
    x1 = (x0 + size * rng.uniform(-1, 1, count)).astype(F)
    y0 = (x0 + size * rng.uniform(-1, 1, count)).astype(F)
    small, linear = step(z, y0, x0, x1), follow(z, y0, x0, x1, "exact")
    apart = np.abs(small.astype(np.float64) - linear)
    assert np.all(apart < size**2 + 5e-7)
    if size > 1e-2:
        assert apart.max() > 0.1 * size**2  # and yet it is another filter


def test_a_tick_may_be_cut_into_any_number_of_ticks() -> None:
    z, y0, x0, x1 = (v[:2000] for v in anything(100_000, 4))
    usual = (np.abs(x1 - x0) < 5) & (np.abs(x0 - y0) < 5) & (np.abs(x0) < 10)
    z, y0, x0, x1 = (v[usual] for v in (np.clip(z, 1e-3, 30).astype(F), y0, x0, x1))
    whole = closed_form(z, y0, x0, x1)
    assert len(whole) > 50
    for cuts in (1, 3, 64):
        y, before = y0, x0
        for k in range(1, cuts + 1):
            now = (x0 + (x1 - x0) * F(k / cuts)).astype(F)
            y, before = step((z / F(cuts)).astype(F), y, before, now), now
        assert np.abs(y - whole).max() < 3e-6 * math.sqrt(cuts)


# the whole pixel
SIDE = 48
IDEAL = SensorParameters("ideal", SIDE, SIDE, 0.2, 0.2, exposure_dn=1.0)
LARGE = replace(
    IDEAL, log="ln", dark_lux=1e-3, dim_lux=1e-3, cutoff_hz=300.0, filter="large_signal",
    pos_thres=0.05, neg_thres=0.05,
)  # fmt: skip


def time_of_us(share: float, before: float, after: float) -> float:
    """Time of the first event past this share of a step of light, in DN."""
    levels = [np.full((SIDE, SIDE), value, F) for value in (before, after)]
    model = PlainModel(LARGE, 1)
    _, state = model.step(levels[0], model.init(0), -1, 0)
    # the step comes in a tick of 1 us, and nothing is cut afterwards
    times: list[int] = []
    end = 0
    for length in [1] + [20] * 20_000:
        events, state = model.step(levels[1], state, end, end + length)
        times += events["t"][(events["x"] == 0) & (events["y"] == 0)].tolist()
        end += length
        if len(times) >= events_of(share, math.log(after / before)):
            return float(times[events_of(share, math.log(after / before)) - 1])
    raise AssertionError("the step never came through")


def events_of(share: float, step: float) -> int:
    """How many thresholds pass this share of a step of log light."""
    return math.floor(share * abs(step) / 0.05) + 1


@pytest.mark.parametrize(("share", "slower"), [(0.5, 2.0), (0.9, 5.0)])
def test_steps_into_light_are_fast_and_into_the_dark_slow(share: float, slower: float) -> None:
    """Steps by 16 against q(t) = 1 + (q0 - 1) e^-wt with w of the new light."""
    low, high, depth = 4.0, 64.0, math.log(16.0)

    def expected(after: float, sign: float) -> float:
        w = 2 * math.pi * 300e-6 * (after * 1000 / 255) / 1000
        at = events_of(share, depth) * 0.05
        # (e^(left over) - 1) / (e^depth - 1) = e^-wt
        left = math.expm1(sign * (depth - at)) / math.expm1(sign * depth)
        return -math.log(left) / w

    up, down = time_of_us(share, low, high), time_of_us(share, high, low)
    assert up == pytest.approx(expected(high, 1.0), rel=0.01)
    assert down == pytest.approx(expected(low, -1.0), rel=0.01)
    # in 16 times the light w is 16 times as large, but a fall begins fast
    assert slower < down / up < 16.0


def rising(t_us: float) -> F32:
    """Half a period of 2 Hz, trough to peak, of another height in each pixel."""
    heights = np.linspace(0.55, 1.95, SIDE * SIDE).reshape(SIDE, SIDE)
    log = MIDDLE - heights * math.cos(2 * math.pi * 2.0 * t_us * 1e-6)
    return np.asarray(np.exp(log), F)


def nth(events: Events) -> dict[tuple[int, int], int]:
    """(pixel, how manieth of its ON events) -> stamp."""
    seen, stamps = np.zeros(SIDE * SIDE, int), {}
    for t, x, y in events[events["p"] == 1][["t", "x", "y"]].tolist():
        pixel = y * SIDE + x
        stamps[pixel, int(seen[pixel])] = t
        seen[pixel] += 1
    return stamps


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("bandwidth", "order"),
    [
        # the same in any light: the step is the exact solution, and light is a line to dt^2
        ({"cutoff_hz": 8.0, "dim_lux": 1e6, "bright_lux": 1e-3}, 2),
        # in proportion to light: a tick has the bandwidth of its end, to dt, as in "exact"
        ({"cutoff_hz": 50.0, "dim_lux": 0.1, "dark_lux": 0.1, "log": "ln"}, 1),
    ],
)
def test_crossing_times_converge_with_the_tick(bandwidth: dict[str, float], order: int) -> None:
    sensor = replace(IDEAL, filter="large_signal", **bandwidth)  # type: ignore[arg-type]
    exact = nth(run(sensor, rising, 125, 250_000))
    deviation = []
    for tick_us in (25_000, 12_500, 6_250, 3_125):
        stamps = nth(run(sensor, rising, tick_us, 250_000))
        errors = [
            stamps[key] - t for key, t in exact.items() if key in stamps and 60_000 < t < 200_000
        ]
        assert len(errors) > 5000
        deviation.append(math.sqrt(np.mean(np.square(errors))))
    found = np.log2(np.array(deviation[:-1]) / deviation[1:])
    assert np.all(np.abs(found - order) < 0.25), (found, deviation)


def test_black_to_sun_and_back_in_single_ticks() -> None:
    """Ticks of 1 us to 1 s: every state stays a number, and sun and black are reached."""
    sensor = replace(LARGE, cutoff_hz=3000.0, follower_hz=300.0, pos_thres=0.2, neg_thres=0.2)
    black, sun = np.zeros((SIDE, SIDE), F), np.full((SIDE, SIDE), 1e12, F)
    for tick_us in (1, 1000, 1_000_000):
        model = PlainModel(sensor, 1)
        state = model.init(0)
        for k, light in enumerate([black, sun, sun, black, black, sun]):
            _, state = model.step(light, state, k * tick_us, (k + 1) * tick_us)
            assert state.filtered is not None
            assert np.isfinite(state.filtered).all()
            if light is sun:
                # sunlight of 1e12 DN is followed within a us
                assert state.filtered == pytest.approx(state.last_log, abs=1e-4)
            left = np.abs(state.filtered)
            assert np.all((left == 0) | (left >= FADED))


def test_blocks_of_settled_pixels_are_skipped() -> None:
    light = np.random.default_rng(5).uniform(20, 200, (SIDE, SIDE)).astype(F)
    model = PlainModel(LARGE, 1)
    _, state = model.step(light, model.init(0), 0, 1000)
    _, state = model.step(light * F(2), state, 1000, 2000)
    for k in range(2, 400):
        _, state = model.step(light * F(2), state, k * 1000, (k + 1) * 1000)
    assert state.since_us is not None
    assert np.all(state.since_us < 300_000)
