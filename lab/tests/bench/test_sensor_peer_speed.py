"""Event pixels per frame on one core: ours beside eventcv's, on one film of 1000 frames a second.

Both do the work of one model: v2e's thresholds, bandwidth, leak, shot noise and dead time, with
eventcv's defaults, and the same without noise. Photon noise is a row of its own. The limit is the
memory: what each pixel has to read and write in a frame is set against a copy of the same process.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from evs.emulator.sensor import PlainModel, SensorParameters
from speed.drifting import eventcv, film
from speed.elsewhere import elsewhere
from speed.turns import Table, Time, milliseconds, target

PEER, PEER_QUIET = "eventcv, its defaults", "eventcv, no noise"
OURS, OURS_QUIET = "evs, the same", "evs, no noise"
OURS_PHOTON = "evs, photon noise"
YARDSTICKS = {OURS: PEER, OURS_PHOTON: PEER, PEER_QUIET: PEER, OURS_QUIET: PEER}
ROUNDS = 9

SIZES = {"346x260": (346, 260, 60), "1280x720": (1280, 720, 20)}

NOISE = {
    "sigma_thres": 0.03,
    "cutoff_hz": 200.0,
    "leak_rate_hz": 1.0,
    "shot_noise_rate_hz": 10.0,
    "refractory_period_s": 100e-6,
}
# its deviation is a sixth of the threshold in all light
PHOTON = NOISE | {
    "shot_noise_rate_hz": 0.0,
    "follower_hz": 3000.0,
    "dark_lux": 1.0,
    "dim_lux": 1.0,
    "photocurrent_pa": 0.16,
}
QUIET: dict[str, Any] = {"sigma_thres": 0.0, "leak_rate_hz": 0.0, "shot_noise_rate_hz": 0.0}

# read and written for each pixel and frame: light 4, last light 8, last log 8, thresholds 8,
# reference 8; with noise the filter's state 8, the leak 4, and the reference is written, 8
BYTES = {OURS_QUIET: 36, OURS: 56}


def emulate(light: Any, terms: dict[str, float]) -> Callable[[], int]:
    """The film to its end, or from there back, in turns, as a camera goes on; how many events."""
    height, width = light.shape[1:]
    sensor = SensorParameters("bench", width, height, 0.2, 0.2, linlog_dn=20.0, **terms)
    model = PlainModel(sensor, 1)
    _, state = model.step(light[0], model.init(0), -1000, 0)
    onwards, back = list(light[1:]), list(light[-2::-1])

    def run() -> int:
        nonlocal onwards, back, state
        events = 0
        for frame in onwards:
            now_us = state.clock_us
            found, state = model.step(frame, state, now_us, now_us + 1000)
            events += len(found)
        onwards, back = back, onwards
        return events

    return run


def gigabytes_per_second() -> float:
    """Of a copy on one core, reads and writes counted, far larger than any cache."""
    source = np.ones(1 << 25)
    target_array = np.empty_like(source)
    took = milliseconds({"copy": lambda: np.copyto(target_array, source)}, 5)["copy"]
    return 2 * source.nbytes / took.median / 1e6


@pytest.mark.bench
def test_event_pixels_beside_eventcv() -> None:
    columns: dict[str, dict[str, Time]] = {}
    counts: dict[str, str] = {}
    one_core = {"RAYON_NUM_THREADS": "1"}
    for size, (width, height, frames) in SIZES.items():
        light = film(width, height, frames)
        with (
            elsewhere(eventcv, width, height, frames, {}, environment=one_core) as peer,
            elsewhere(eventcv, width, height, frames, QUIET, environment=one_core) as peer_quiet,
        ):
            ours, ours_quiet = emulate(light, NOISE), emulate(light, {})
            calls = {PEER: peer.call, OURS: ours, PEER_QUIET: peer_quiet.call}
            calls[OURS_PHOTON] = emulate(light, PHOTON)
            calls[OURS_QUIET] = ours_quiet
            counts[size] = ", ".join(
                f"{name} {call() / (frames - 1):.0f}" for name, call in calls.items()
            )
            taken = milliseconds(calls, ROUNDS)
        columns[size] = {name: time / (frames - 1) for name, time in taken.items()}
    print(Table("one frame of event pixels, one core", columns, YARDSTICKS))
    memory = gigabytes_per_second()
    for size, (width, height, _) in SIZES.items():
        print(f"events a frame, {size}: {counts[size]}")
        for row, each in BYTES.items():
            moved = each * width * height / columns[size][row].median / 1e6
            print(f"{row}, {size}: {each} bytes a pixel, {moved:.1f} GB/s; a copy: {memory:.1f}")
    for size, times in columns.items():
        peer_ms = times[PEER].median
        print(target(f"{OURS}, {size}", peer_ms / times[OURS].median, 10, "x"))
        print(target(f"{OURS_PHOTON}, {size}", peer_ms / times[OURS_PHOTON].median, 4, "x"))
        print(target(f"{OURS_QUIET}, {size}", peer_ms / times[OURS_QUIET].median, 20, "x"))
        assert times[OURS_QUIET].median > 0
