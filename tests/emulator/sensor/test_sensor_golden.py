"""Events of two published emulators on one video; tests/support/golden/README.md describes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.pixel import log_light
from evs.msgs import EVENT_DTYPE, Events

pytestmark = pytest.mark.golden

DATA = Path(__file__).parents[2] / "support" / "golden"
THETA = 0.2

Counts = np.ndarray[Any, np.dtype[np.int64]]


def load(name: str) -> dict[str, Any]:
    with np.load(DATA / f"{name}.npz") as file:
        return {key: file[key] for key in file}


@pytest.fixture(scope="module")
def video() -> Any:
    return load("video")["luminance_dn"]


def ideal(log: str, linlog_dn: float = 20.0) -> SensorParameters:
    """No noise; luminance is DN already."""
    return SensorParameters(
        "golden", 64, 48, THETA, THETA, log=log, linlog_dn=linlog_dn, exposure_dn=1.0
    )


def emulate(video: Any, sensor: SensorParameters) -> Events:
    """Frame k is at k ms."""
    model = PlainModel(sensor, 2)
    state, found = model.init(0), []
    for k, frame in enumerate(video):
        events, state = model.step(frame, state, (k - 1) * 1000, k * 1000)
        found.append(events)
    return np.frombuffer(b"".join(events.tobytes() for events in found), EVENT_DTYPE)


def count(t: Any, x: Any, y: Any, p: Any) -> Counts:
    """(2, 300, 48, 64) events per polarity, frame and pixel; frame k owns ((k-1) ms, k ms]."""
    counts = np.zeros((2, 300, 48, 64), np.int64)
    np.add.at(counts, (p, -(-t // 1000), y, x), 1)
    return counts


def net(counts: Counts) -> Counts:
    """(300, 48, 64) ON minus OFF events so far."""
    return np.cumsum(counts[1] - counts[0], axis=0)


def contrast(video: Any, sensor: SensorParameters) -> Any:
    """(300, 48, 64) thresholds by which log light lies over that of frame 0."""
    light = log_light(video, sensor).astype(np.float64)
    return (light - light[0]) / THETA


@pytest.fixture(scope="module")
def esim() -> dict[str, Any]:
    return load("esim_events")


@pytest.fixture(scope="module")
def on_esims_map(video: Any) -> Events:
    return emulate(video, ideal("log_eps"))


def test_esim_events_but_for_its_rounding(
    video: Any, esim: dict[str, Any], on_esims_map: Events
) -> None:
    ours = count(*(on_esims_map[name] for name in "txyp"))
    theirs = count(*(esim[name] for name in ("t_us", "x", "y", "p")))
    assert theirs.sum() == 517_382
    # exact arithmetic has 261 pairs of events that ESIM's float32 loses, nothing else
    assert np.abs(ours.sum((0, 1)) - theirs.sum((0, 1))).sum() == 522
    assert ours.sum() - theirs.sum() == 522

    # the two part by one event, and only in frames at whose end light lies on a level: within 1e-5,
    # or within the microsecond to which stamps are rounded
    apart = net(ours) - net(theirs)
    assert np.abs(apart).max() == 1
    parting = (np.diff(apart, axis=0) != 0) & (apart[1:] != 0)
    thresholds = contrast(video, ideal("log_eps"))
    speed = np.abs(np.diff(thresholds, axis=0, append=thresholds[-1:]))
    a_microsecond = 1e-3 * np.maximum(speed[:-1], speed[1:])
    off_level = np.abs(thresholds - np.round(thresholds))[1:]
    assert np.count_nonzero(parting) > 0
    assert np.all((off_level < 1e-5 / THETA + a_microsecond)[parting])


def test_esim_stamps(esim: dict[str, Any], on_esims_map: Events) -> None:
    """Pixel by pixel, wherever both have the same number of events: within 1 us, same polarity."""

    def by_pixel(t: Any, x: Any, y: Any, p: Any) -> tuple[Any, Any, Any]:
        pixel = y.astype(np.int64) * 64 + x
        order = np.lexsort((t, pixel))
        return pixel[order], t[order], p[order]

    ours = by_pixel(*(on_esims_map[name] for name in "txyp"))
    theirs = by_pixel(*(esim[name] for name in ("t_us", "x", "y", "p")))
    same = np.bincount(ours[0], minlength=3072) == np.bincount(theirs[0], minlength=3072)
    assert np.count_nonzero(same) > 2500
    a, b = same[ours[0]], same[theirs[0]]
    assert np.abs(ours[1][a] - theirs[1][b]).max() <= 1
    assert np.array_equal(ours[2][a], theirs[2][b])


def test_v2e_counts(video: Any) -> None:
    sensor = ideal("linlog", 20.0)
    events = emulate(video, sensor)
    ours = count(*(events[name] for name in "txyp"))
    golden = load("v2e_counts")
    theirs = np.stack([golden["ideal_off"], golden["ideal_on"]]).astype(np.int64)
    for polarity in (0, 1):
        assert ours[polarity].sum() == pytest.approx(theirs[polarity].sum(), rel=0.005)
    # at every pixel and frame, the net count is within one threshold of the light
    thresholds = contrast(video, sensor)
    assert np.abs(net(ours) - thresholds).max() < 1 + 1e-6
    assert np.abs(net(theirs) - thresholds).max() < 1 + 1e-4
    assert np.abs(net(ours) - net(theirs)).max() <= 1


# v2e's low pass: a pole at 200 Hz times (DN + 20) / 275, its step y += min(1, 2 pi f dt) (x - y)
CUTOFF_HZ, POS, NEG = 200.0, 0.25, 0.15


def lowpass(filter_: str) -> SensorParameters:
    """As v2e_counts.npz has it; dim_lux and bright_lux are v2e's 20 and 255 DN by default."""
    return SensorParameters(
        "golden", 64, 48, POS, NEG, log="linlog", linlog_dn=20.0, exposure_dn=1.0,
        cutoff_hz=CUTOFF_HZ, filter=filter_,
    )  # fmt: skip


def euler(video: Any) -> Any:
    """(300, 48, 64) log light after v2e's step, float64."""
    dn = video.astype(np.float64)
    log = np.where(dn >= 20, np.log(np.maximum(dn, 20)), np.log(20) / 20 * dn)
    share = np.minimum(1, 2 * np.pi * CUTOFF_HZ * 1e-3 * (dn + 20) / 275)
    filtered = log.copy()
    for k in range(1, len(log)):
        filtered[k] = filtered[k - 1] + share[k] * (log[k] - filtered[k - 1])
    return filtered


def told(counts: Counts) -> Any:
    """(300, 48, 64) log units that the events so far add up to."""
    return np.cumsum(POS * counts[1] - NEG * counts[0], axis=0)


def test_v2e_counts_with_its_low_pass(video: Any) -> None:
    events = emulate(video, lowpass("euler"))
    ours = count(*(events[name] for name in "txyp"))
    golden = load("v2e_counts")
    theirs = np.stack([golden["lowpass_off"], golden["lowpass_on"]]).astype(np.int64)
    for polarity in (0, 1):
        assert ours[polarity].sum() == pytest.approx(theirs[polarity].sum(), rel=0.005)
    assert ours.sum() > 200_000
    # the events so far tell the filtered light within one threshold, at every pixel and frame
    filtered = euler(video)
    filtered -= filtered[0]
    for counts, rounding in ((ours, 1e-5), (theirs, 1e-4)):
        assert np.all(filtered - told(counts) < POS + rounding)
        assert np.all(told(counts) - filtered < NEG + rounding)


def test_the_exact_step_follows_light_that_is_a_line_in_each_tick(video: Any) -> None:
    """Closed form: with w = 2 pi f of the tick's last light, y' = w (x - y) and x a line."""
    dn = video.astype(np.float64)
    log = np.where(dn >= 20, np.log(np.maximum(dn, 20)), np.log(20) / 20 * dn)
    z = 2 * np.pi * CUTOFF_HZ * 1e-3 * (dn + 20) / 275
    filtered = log.copy()
    for k in range(1, len(log)):
        # a line has the particular solution x - slope / w; what the start is off it decays
        lag = (log[k] - log[k - 1]) / z[k]
        start = filtered[k - 1] - (log[k - 1] - lag)
        filtered[k] = log[k] - lag + start * np.exp(-z[k])
    filtered -= filtered[0]
    events = emulate(video, lowpass("exact"))
    ours = count(*(events[name] for name in "txyp"))
    assert np.all(filtered - told(ours) < POS + 1e-4)
    assert np.all(told(ours) - filtered < NEG + 1e-4)
    # v2e's step has the whole tick see the new light: it is ahead, and has more events
    euler_events = len(emulate(video, lowpass("euler")))
    assert 0.01 < 1 - len(events) / euler_events < 0.04
