"""The shares of one pole in a tick: the closed form within their error, the bits of the oracle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.sensor.reference.filters import FADED, follow, shares

F = np.float32
EVERY_Z = np.concatenate(
    [
        np.geomspace(1e-37, 1e30, 300_001).astype(F),
        np.linspace(0.04, 0.06, 20_001).astype(F),  # around the change from series to 1 - a / z
        np.linspace(0.0, 88.0, 20_001).astype(F)[1:],
    ]
)


def exact(z: F32) -> tuple[np.ndarray, np.ndarray]:
    """1 - e^-z and 1 - (1 - e^-z) / z in float64; the second by its series where it cancels."""
    wide = z.astype(np.float64)
    a = -np.expm1(-wide)
    near = np.minimum(wide, 0.5)
    series = sum((-1.0) ** n * near ** (n + 1) / math.factorial(n + 2) for n in range(14))
    return a, np.where(wide < 0.5, series, 1.0 - a / wide)


def test_both_shares_are_the_closed_form() -> None:
    """From z = .047 on b is a difference from 1: what cancels there is 2^-24 of b > .023."""
    a, b = _core.lowpass_steps(EVERY_Z)
    exact_a, exact_b = exact(EVERY_Z)
    assert np.max(np.abs(a / exact_a - 1.0)) < 1e-6
    assert np.max(np.abs(b / exact_b - 1.0)) < 4e-6


def test_shares_are_shares_and_grow_with_z() -> None:
    z = np.sort(EVERY_Z)
    for share in _core.lowpass_steps(z):
        assert np.all((share >= 0.0) & (share <= 1.0))
        growth = np.diff(share.astype(np.float64))
        assert np.all(growth >= -4e-6 * share[1:])  # but for rounding


def test_no_time_moves_nothing_and_no_number_is_settled() -> None:
    a, b = _core.lowpass_steps(np.array([0.0, -0.0, 80.0, 1e30, np.inf, np.nan], F))
    assert np.array_equal(a, F([0, 0, 1, 1, 1, 1]))
    assert np.array_equal(b[:2], F([0, 0]))
    assert np.array_equal(b[2:], F([1 - 1 / 80, 1, 1, 1]))


def test_shares_have_the_oracles_bits() -> None:
    z = np.concatenate([EVERY_Z, F([0.0, 100.0, np.inf, np.nan, 0.046875, 80.0])])
    for ours, theirs in zip(_core.lowpass_steps(z), shares(z), strict=True):
        assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("law", ["exact", "euler"])
def test_a_settled_filter_stands_still(law: str) -> None:
    y = np.random.default_rng(1).normal(0, 3, 10_000).astype(F)
    for z in (1e-6, 0.1, 0.3, 5.0, 100.0):
        assert follow(np.full_like(y, z), y, y, y, law).tobytes() == y.tobytes()


def test_a_line_is_followed_exactly_in_one_tick_and_in_many() -> None:
    """y' = w (x - y), x = t: y = t - (1 - e^-wt) / w, however the time is cut."""
    w, length = 0.7, 8.0
    expected = length - (1.0 - np.exp(-w * length)) / w
    for cuts in (1, 3, 64, 1000):
        y = np.zeros(1, F)
        dt = length / cuts
        for k in range(cuts):
            y = follow(F([w * dt]), y, F([k * dt]), F([(k + 1) * dt]), "exact")
        assert y[0] == pytest.approx(expected, rel=3e-6 * np.sqrt(cuts))


@pytest.mark.parametrize("law", ["exact", "euler"])
def test_what_fades_is_0_before_it_is_a_denormal(law: str) -> None:
    y, zero = F([1.0]), F([0.0])
    seen = []
    for _ in range(200):
        y = follow(F([0.6]), y, zero, zero, law)
        seen.append(float(y[0]))
    assert min(value for value in seen if value) >= FADED
    assert seen[-1] == 0.0
