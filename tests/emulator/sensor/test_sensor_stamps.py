"""Stamps fall anywhere in a tick: with 2000 events and more, at least 800 of the 1000 occur."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import scipy

from evs.emulator.sensor import SensorParameters
from evs.msgs import Events
from reference.waves import Waves, run

pytestmark = pytest.mark.statistical

TICK = 1000
VIDEO = Path(__file__).parents[2] / "support" / "golden" / "video.npz"


def stamps_in_busy_ticks(events: Events, last_tick: int) -> list[np.ndarray]:
    """(t - 1) mod 1000 of the events of every tick that has 2000 of them."""
    edges = np.searchsorted(events["t"], np.arange(last_tick + 1) * TICK, "right")
    return [
        (events["t"][first:last] - 1) % TICK
        for first, last in pairwise(edges)
        if last - first >= 2000
    ]


def test_stamps_of_moving_light() -> None:
    side = 160
    sensor = SensorParameters("waves", side, side, 0.2, 0.2, exposure_dn=1.0)
    events = run(sensor, Waves.of(side, 16.0, 2).luminance, TICK, 100 * TICK)
    # every pixel begins in the middle between two levels: wait until it has forgotten that
    busy = stamps_in_busy_ticks(events[events["t"] > 40 * TICK], 100)
    assert len(busy) == 60
    # 2000 numbers of 1000 leave 135 +- 9 out
    assert min(len(np.unique(stamps)) for stamps in busy) >= 800
    # and none of them is preferred: fifty bins of each tick, significance 1e-3 for all together
    significance = 1e-3 / len(busy)
    for stamps in busy:
        found = np.bincount(stamps // 20, minlength=50)
        assert scipy.stats.chisquare(found).pvalue > significance


def test_stamps_of_the_golden_video() -> None:
    """Texture drift, flicker, a rotating bar: whatever moves, in every tick that is busy enough.

    A quarter of its pixels flicker alike; v2e's spread of thresholds tells them apart.
    """
    with np.load(VIDEO) as file:
        video = file["luminance_dn"]
    sensor = SensorParameters("golden", 64, 48, 0.2, 0.2, 0.03, exposure_dn=1.0)
    events = run(sensor, lambda t_us: video[int(t_us) // TICK], TICK, 299 * TICK)
    busy = stamps_in_busy_ticks(events, 299)
    assert len(busy) > 100
    assert min(len(np.unique(stamps)) for stamps in busy) >= 800
