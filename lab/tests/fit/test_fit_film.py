"""Light between frames: beside the light itself, and beside straight lines between the frames."""

from __future__ import annotations

import numpy as np
import pytest

from evs_lab.fit.film import STEP_PX, Film
from evs_lab.fit.frames import FrameLight

HEIGHT, WIDTH, SPEED_PX = 96, 128, 6.0
DARK = 8.0


def light(frame: float) -> np.ndarray:
    """A disc and waves that move to the right, DN."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    x = x - SPEED_PX * frame
    disc = 1.0 / (1.0 + np.exp(np.hypot(x - 50.0, y - 48.0) - 20.0))
    return 60.0 + 25.0 * np.sin(x / 7.0) * np.sin(y / 9.0) + 100.0 * disc


def film(noise: float = 0.0) -> Film:
    random = np.random.default_rng(0)
    dn = np.array([light(k) for k in range(4)]).reshape(4, -1) + DARK
    dn += noise * random.standard_normal(dn.shape)
    return Film(FrameLight(40_000.0 * np.arange(4), dn.astype(np.float32)), (HEIGHT, WIDTH),
                DARK, 0.2)  # fmt: skip


def test_pictures_between_frames_show_the_moving_light() -> None:
    own = film()
    assert len(own) == len(own.t_us)
    assert own.t_us[0] == 0.0
    assert own.t_us[-1] == 120_000.0
    # no picture is farther than half a pixel from the next
    assert np.diff(own.t_us).max() <= 1.05 * 40_000.0 * STEP_PX / SPEED_PX
    inner = np.s_[12:-12, 24:-24]
    worst = []
    for k, t_us in enumerate(own.t_us):
        at = t_us / 40_000.0
        first = min(int(at), 2)
        straight = (first + 1 - at) * light(first) + (at - first) * light(first + 1)
        by_flow, by_line = (
            np.sqrt(np.mean(np.log(one / light(at))[inner] ** 2)) for one in (own[k], straight)
        )
        if 0.3 < at - first < 0.7:
            worst.append(by_flow / by_line)
    assert max(worst) < 0.35


def test_a_frame_has_less_noise_than_was_recorded() -> None:
    own = film(noise=3.0)
    whole = int(np.flatnonzero(own.t_us == 40_000.0)[0])
    left = own[whole] - light(1.0)
    assert np.std(left[12:-12, 24:-24]) < 0.8 * 3.0


def test_a_lamp_that_brightens_is_not_blurred_in_time() -> None:
    dn = np.exp(np.array([3.0, 3.2, 3.4, 5.0, 5.0]))[:, None] * np.linspace(0.8, 1.2, 64 * 64)
    own = Film(FrameLight(40_000.0 * np.arange(5), dn.astype(np.float32)), (64, 64), 0.0, 0.2)
    for k in (0, 1, 4):
        shown = own[int(np.flatnonzero(own.t_us == 40_000.0 * k)[0])]
        np.testing.assert_allclose(shown.ravel(), dn[k] + 0.5, rtol=0.02)


@pytest.mark.parametrize("shape", [(1, 40), (20, 20), (31, 200)])
def test_small_frames_are_blended(shape: tuple[int, int]) -> None:
    pixels = shape[0] * shape[1]
    dn = np.array([np.full(pixels, 50.0), np.full(pixels, 100.0)], np.float32)
    own = Film(FrameLight(np.array([0.0, 40_000.0]), dn), shape, 0.0, 0.2)
    assert len(own) == 2
    np.testing.assert_allclose(own[0], np.full(shape, 50.5))
    np.testing.assert_allclose(own[1], np.full(shape, 100.5))
