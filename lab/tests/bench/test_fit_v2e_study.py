"""`evs fit` on events of v2e, whose parameters are known: a lens cap, a ramp and a lamp."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import evs
from evs.emulator.base.scene import F32
from evs.msgs import make_events
from evs_lab.fit import FittedCamera, Light, Observed, fit_camera
from speed.elsewhere import AbsentError
from speed.v2e import v2e_events

WIDTH, HEIGHT = 64, 48
SET = {
    "pos_thres": 0.22,
    "neg_thres": 0.26,
    "sigma_thres": 0.03,
    "cutoff_hz": 0.0,
    "leak_rate_hz": 0.3,
    "shot_noise_rate_hz": 0.2,
    "refractory_period_s": 0.0,
    "leak_jitter_fraction": 0.0,
    "noise_rate_cov_decades": 0.15,
    "seed": 7,
}
CAP_S, CAP_SETTLES_S = 40, 10
# of its log-normal leak rates, whose median is set
MEAN_LEAK_HZ = 0.3 * float(np.exp(0.5 * (0.15 * np.log(10.0)) ** 2))


def cap() -> F32:
    return np.ones(1000 * CAP_S, np.float32)


def ramp() -> F32:
    u = np.arange(8001) % 1000 / 500
    return (60.0 * 4.0 ** np.minimum(u, 2.0 - u)).astype(np.float32)


def lamp() -> F32:
    return np.where(np.arange(12001) // 500 % 2 == 0, 30.0, 240.0).astype(np.float32)


def seen(folder: Path, dn: F32, name: str, after_us: int = 0) -> Observed:
    """v2e's events of light that is the same for all pixels, (n,) DN, 1 ms apart."""
    frames = np.broadcast_to(dn[:, None, None], (len(dn), HEIGHT, WIDTH))
    found = v2e_events(folder, frames, SET)
    t_us = np.round(1e6 * found[:, 0]).astype(np.int64)
    found, t_us = found[t_us > after_us], t_us[t_us > after_us]
    order = np.argsort(t_us, kind="stable")
    x, y, sign = (found[order, k].astype(np.int64) for k in (1, 2, 3))
    return Observed(
        make_events(t_us[order], x, y, (sign > 0).astype(np.int64)), WIDTH, HEIGHT, name
    )


@pytest.mark.bench
@pytest.mark.slow
def test_fit_finds_what_v2e_was_set_to(tmp_path: Path) -> None:
    base = evs.Pixels("v2e").sensor
    try:
        dark = Light(seen(tmp_path, cap(), "cap", 1_000_000 * CAP_SETTLES_S), "dark", 0.0)
        fits: dict[str, FittedCamera] = {
            "cap and ramp": fit_camera(
                [dark, Light(seen(tmp_path, ramp(), "ramp"), "ramp", None, 4.0)], base
            ),
            "cap and lamp": fit_camera(
                [dark, Light(seen(tmp_path, lamp(), "lamp"), "lamp", None, 8.0)], base
            ),
        }
    except AbsentError as absent:
        print(absent)
        return
    print(f"\nleak_rate_hz: mean {MEAN_LEAK_HZ:.3f}")
    for key, value in SET.items():
        for name, fit in fits.items():
            one = next((each for each in fit.estimates if each.key == key), None)
            if one is not None and one.told:
                print(f"{key}, set {value}, {name}: {one.number:.4f} +- {one.error:.4f}")
    for fit in fits.values():
        for key in ("pos_thres", "neg_thres", "sigma_thres"):
            assert abs(fit[key].number - SET[key]) < 3.0 * fit[key].error
