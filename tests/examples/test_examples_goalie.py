"""A ball's path from events and from frames, and the paddle that meets it."""

from __future__ import annotations

import numpy as np
import pytest

from evs.examples.goalie.controller import FORCE_N, MASS_KG, Goalkeeper
from evs.examples.goalie.speed_curve import CurvePlan, half_speed, speeds_of
from evs.examples.goalie.tracker import (
    CENTRE_PX,
    FOCAL_PX,
    HEIGHT_M,
    LOOKS_AT_X_M,
    BallPath,
    EventBallTracker,
    FrameBallTracker,
    on_table,
)
from evs.msgs import EVENT_DTYPE, Events, Frame

SCALE = FOCAL_PX / HEIGHT_M
BEGIN = np.array([1.0, 0.2])
SPEED = np.array([-5.0, -0.8])
CROSSES_Y = 0.2 - 0.8 / 5.0
DIAMETER_PX = 4.3


def pixel(place: np.ndarray) -> np.ndarray:
    return np.array([CENTRE_PX + (place[0] - LOOKS_AT_X_M) * SCALE, CENTRE_PX - place[1] * SCALE])


def ball_events(tick: int, random: np.random.Generator) -> Events:
    """Events all over the ball's rim in one tick, with noise anywhere."""
    events = np.zeros(14, EVENT_DTYPE)
    t_us = 1000 * tick + np.sort(random.integers(1, 1001, 14))
    turn = random.uniform(0.0, 2.0 * np.pi, 14)
    for k in range(14):
        x, y = pixel(BEGIN + SPEED * t_us[k] * 1e-6)
        rim = DIAMETER_PX / 2 * np.array([np.cos(turn[k]), np.sin(turn[k])])
        events["x"][k], events["y"][k] = np.rint(np.array([x, y]) + rim)
    events["t"] = t_us
    events["x"][3], events["y"][3] = random.integers(0, 128, 2)
    return events


def test_pixels_and_table() -> None:
    x, y = on_table(np.array([CENTRE_PX]), np.array([CENTRE_PX]))
    assert (x[0], y[0]) == (LOOKS_AT_X_M, 0.0)
    np.testing.assert_allclose(np.ravel(on_table(*pixel(BEGIN))), BEGIN)


def test_events_of_a_ball_say_where_it_will_cross() -> None:
    random, ball = np.random.default_rng(2), EventBallTracker()
    for tick in range(100):
        ball.update(ball_events(tick, random), 1000 * (tick + 1))
    crossing = ball.path.crossing(100_000)
    assert crossing is not None
    # 1300 events, 1.5 px rms off, over 100 ms: 1.5 / sqrt(1300) * 150 ms / 29 ms, 0.2 px or 2 mm at
    # the goal; three of them, and noise
    assert crossing.y_m == pytest.approx(CROSSES_Y, abs=0.008)
    assert crossing.t_s == pytest.approx(0.2, abs=0.004)


def test_a_cluster_that_was_none_is_given_up() -> None:
    random, ball = np.random.default_rng(9), EventBallTracker()
    wrong = np.zeros(8, EVENT_DTYPE)
    wrong["x"], wrong["y"], wrong["t"] = 50, 100, np.arange(1, 9)
    ball.update(wrong, 1000)
    assert ball.path.at(1000) is not None
    for tick in range(1, 120):
        ball.update(ball_events(tick, random), 1000 * (tick + 1))
    crossing = ball.path.crossing(120_000)
    assert crossing is not None
    assert crossing.y_m == pytest.approx(CROSSES_Y, abs=0.01)


def test_noise_alone_is_no_ball() -> None:
    random, ball = np.random.default_rng(4), EventBallTracker()
    for tick in range(100):
        events = np.zeros(4, EVENT_DTYPE)
        events["x"], events["y"] = random.integers(30, 128, (2, 4))
        events["t"] = 1000 * tick + 1
        ball.update(events, 1000 * (tick + 1))
    assert ball.path.at(100_000) is None
    assert ball.path.crossing(100_000) is None


def frame_of(begin_us: int, end_us: int) -> Frame:
    """A dark ball on a bright table, blurred along its way."""
    pixels = np.full((128, 128), 200.0)
    y, x = np.mgrid[:128, :128]
    for t_us in np.linspace(begin_us, end_us, 21):
        middle = pixel(BEGIN + SPEED * t_us * 1e-6)
        off = np.hypot(x - middle[0], y - middle[1]) - DIAMETER_PX / 2
        pixels -= 160.0 / 21 * np.clip(0.5 - off, 0.0, 1.0)
    return Frame(0, begin_us, begin_us, end_us, end_us, np.rint(pixels).astype(np.uint8))


def test_frames_of_a_ball_say_where_it_will_cross() -> None:
    ball = FrameBallTracker()
    for index in range(3):
        ball.update(frame_of(16_667 * index, 16_667 * index + 5000))
        # of one sample nobody knows a speed
        assert (ball.path.crossing(50_000) is None) == (index == 0)
    crossing = ball.path.crossing(50_000)
    assert crossing is not None
    assert crossing.y_m == pytest.approx(CROSSES_Y, abs=0.003)


def test_an_empty_frame_says_nothing() -> None:
    ball = FrameBallTracker()
    ball.update(Frame(0, 0, 0, 5000, 5000, np.full((128, 128), 200, np.uint8)))
    assert ball.path.at(0) is None


def test_a_path_goes_through_its_samples_at_any_time_of_day() -> None:
    for day_us in (0, 86_400_000_000):
        path, t_us = BallPath(1e-6), day_us + np.array([1000, 2000, 7000])
        place = BEGIN[:, np.newaxis] + SPEED[:, np.newaxis] * (t_us - day_us) * 1e-6
        path.add(*pixel(place), t_us)
        found = path.at(day_us + 20_000)
        assert found is not None
        np.testing.assert_allclose(found[0], BEGIN + SPEED * 0.02, atol=1e-9)
        np.testing.assert_allclose(found[1], SPEED, atol=1e-9)


@pytest.mark.parametrize("target", [0.28, -0.1, 0.02])
def test_the_paddle_gets_there_nearly_as_fast_as_can_be_and_stays(target: float) -> None:
    keeper, place, speed = Goalkeeper(frames=False), 0.0, 0.0
    best_s = 2.0 * (abs(target) / (FORCE_N / MASS_KG)) ** 0.5
    ticks = 0
    while abs(place - target) > 0.01 and ticks < 1000:
        speed += keeper._force(target - place, speed) / MASS_KG * 1e-3
        place += speed * 1e-3
        ticks += 1
    assert ticks * 1e-3 < 1.3 * best_s + 0.01
    for _ in range(300):
        speed += keeper._force(target - place, speed) / MASS_KG * 1e-3
        place += speed * 1e-3
        # over the target by less than the ball's radius
        assert (place - target) * np.sign(target) < 0.02
    assert place == pytest.approx(target, abs=1e-3)


def test_the_speed_at_which_half_are_saved() -> None:
    assert half_speed({2.0: 1.0, 4.0: 0.75, 16.0: 0.25}) == pytest.approx(8.0)
    assert half_speed({2.0: 1.0, 4.0: 0.75}) is None
    speeds = speeds_of(CurvePlan())
    assert (speeds[0], speeds[-1], len(speeds)) == (1.0, 64.0, 19)
    assert np.all(np.diff(speeds) > 0)
