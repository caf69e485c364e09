"""The davis346 beside what is published of real ones: leak, its tail, shadows, latency.

`pytest -s` prints the column "measured" of the table in lab/docs/evidence/pixel.md.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.config import SensorConfig
from evs.emulator.sensor import PlainModel, SensorParameters, resolve_sensor

pytestmark = pytest.mark.statistical

DAVIS = replace(resolve_sensor(SensorConfig("davis346")), photocurrent_pa=0.0)
SIZE = (DAVIS.height, DAVIS.width)


def light(lux: float) -> F32:
    return np.full(SIZE, lux / 1000.0, np.float32)


def leaks_hz(lux: float, seconds: int = 40) -> np.ndarray:
    """Events a second of each pixel in still light."""
    model = PlainModel(DAVIS, 2)
    _, state = model.step(light(lux), model.init(1), -1000, 0)
    counts = np.zeros(DAVIS.width * DAVIS.height)
    for k in range(seconds):
        events, state = model.step(light(lux), state, k * 1_000_000, (k + 1) * 1_000_000)
        counts += np.bincount(events["y"].astype(int) * DAVIS.width + events["x"],
                              minlength=counts.size)  # fmt: skip
    return counts / seconds


@pytest.mark.parametrize(("lux", "published_hz"), [(161.0, 0.10), (3000.0, 0.27)])
def test_leak_grows_with_light_as_published(lux: float, published_hz: float) -> None:
    """IEBCS's means, without pixels over 5 Hz, to two digits."""
    rates = leaks_hz(lux)
    mean = rates[rates <= 5.0].mean()
    print(f"leak at {lux:g} lux: {mean:.4f} Hz")
    # half of the last digit, and five standard errors of a mean of 90,000 pixels
    error = rates[rates <= 5.0].std() / math.sqrt(rates.size)
    assert abs(mean - published_hz) < 0.005 + 5 * error


def test_warm_and_hot_pixels_are_as_many_as_published() -> None:
    rates = leaks_hz(161.0)
    for over_hz, published, pixels in ((1.0, 0.022, 55), (5.0, 0.0036, 9), (20.0, 0.0008, 2)):
        share = np.mean(rates > over_hz)
        print(f"pixels over {over_hz:g} Hz: {100 * share:.3f} %")
        # what 2500 real pixels tell: one standard error of their count
        assert abs(share - published) < published / math.sqrt(pixels)


@pytest.mark.parametrize("lux", [100.0, 10.0, 3.0, 1.0])
def test_a_step_by_4_has_its_events_down_to_starlight(lux: float) -> None:
    """An ideal pixel has ln 4 / 0.2 = 6.9; dark current of 0.1 lux leaves 6.6 of them at 1 lux."""
    quiet = replace(DAVIS, leak_rate_hz=0.0, parasitic_leak_hz=0.0, hot_leak_median_hz=0.0)
    events = step_events(quiet, lux)
    knee = step_events(replace(quiet, log="linlog"), lux)
    print(f"step by 4 from {lux:g} lux: {events:.2f} events a pixel; with linlog {knee:.2f}")
    dark = quiet.dark_lux
    exact = math.log((4 * lux + dark) / (lux + dark)) / 0.2
    # whole events only: half an event less on average; thresholds spread by 15 %
    assert abs(events - (exact - 0.5)) < 0.35
    assert knee < events + 0.1
    if lux <= 1.0:
        assert knee < 1.5


def step_events(sensor: SensorParameters, lux: float) -> float:
    """ON events of a pixel after a step of light by 4, once the pixel has settled."""
    model = PlainModel(sensor, 2)
    _, state = model.step(light(lux), model.init(1), -1000, 0)
    count = 0
    # the photoreceptor has 0.4 Hz at a tenth of a lux
    for k in range(60):
        events, state = model.step(light(4 * lux), state, k * 100_000, (k + 1) * 100_000)
        count += int(np.count_nonzero(events["p"]))
    return count / (sensor.width * sensor.height)
