"""Foreign and bad recordings: ESIM's principle, recordings that are too short, wrong or empty."""

from __future__ import annotations

import numpy as np
import pytest

import evs
from evs.msgs import EvsError, make_events
from evs_lab.fit import Light, Observed, combined, fit_camera, fit_still, sensor_toml
from evs_lab.fit.estimate import Estimate, cannot
from reference import lamps

PIXELS = lamps.WIDTH * lamps.HEIGHT
BASE = evs.Pixels("davis346").sensor


def uneven(seed: int, mean: float, sigma: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.maximum(mean + sigma * np.random.default_rng(seed).standard_normal(PIXELS), 0.02)


@pytest.mark.statistical
def test_esims_thresholds_and_refractory_period() -> None:
    on, off = uneven(1, 0.25, 0.03), uneven(2, 0.31, 0.03)
    # steps that no event falls on twice: a line between frames 31 ms apart
    frames = list(lamps.ramp_frames(6.0, 1.0, 6, 500.0, steps=16))
    seen = lamps.esim(iter(frames), on, off)
    found = fit_camera([Light(seen, "ramp", None, 6.0)], BASE)
    # what a leak that nobody recorded may bring is in the errors
    assert abs(found["pos_thres"].number - on.mean()) < 3.0 * found["pos_thres"].error < 0.02
    assert abs(found["neg_thres"].number - off.mean()) < 3.0 * found["neg_thres"].error < 0.02
    sigma = found["sigma_thres"]
    assert abs(sigma.number - 0.03) < 3.0 * sigma.error < 0.003
    # no pixel is dead, and the period of ESIM is 0: only a bound
    assert found["dead_pixel_fraction"].number == 0.0
    assert not found["refractory_period_s"].told


def test_alike_pixels_give_the_ends_of_the_threshold() -> None:
    on, off = np.full(PIXELS, 0.25), np.full(PIXELS, 0.25)
    seen = lamps.esim(lamps.lamp_frames(8.0, 1.0, 8, 800.0), on, off)
    base = evs.Pixels("ideal").sensor
    found = fit_camera([Light(seen, "lamp", 800.0, 8.0)], base)["pos_thres"]
    # ln 8 is between 8 and 9 thresholds
    assert abs(found.number - 0.25) < 2.0 * found.error < 0.03
    assert "same counts" in found.note


def observed(t: list[int], x: int = 0) -> Observed:
    count = len(t)
    events = make_events(t, [x] * count, [0] * count, [k % 2 for k in range(count)])
    return Observed(events, 4, 3, "few.aedat4")


@pytest.mark.parametrize(
    ("t", "x", "what"),
    [
        ([], 0, "few.aedat4 has no events"),
        ([5], 0, "few.aedat4 has 1 event"),
        ([7, 5], 0, "run backwards"),
        ([5, 7], 9, "outside its 4 x 3 px"),
    ],
)
def test_recordings_that_tell_nothing_are_refused(t: list[int], x: int, what: str) -> None:
    with pytest.raises(EvsError, match=what):
        observed(t, x)


@pytest.mark.parametrize("kind", ["dark", "still", "lamp", "ramp", "any"])
def test_a_few_events_tell_nothing_and_break_nothing(kind: str) -> None:
    light = Light(observed(list(range(0, 1000, 7))), kind, 1.0, 4.0, 1e-4)
    found = fit_camera([light], BASE)
    assert found.estimates
    for one in found.estimates:
        assert one.told or one.reason
        assert "\n" not in one.reason


@pytest.mark.parametrize("kind", ["dark", "any"])
def test_one_pixel(kind: str) -> None:
    events = make_events(np.arange(500) * 10_007, [0] * 500, [0] * 500, [1] * 500)
    found = fit_camera([Light(Observed(events, 1, 1, "one"), kind, 0.0)], BASE)
    assert all(one.told or one.reason for one in found.estimates)


def test_light_without_sense_is_refused() -> None:
    few = observed(list(range(0, 1000, 7)))
    for contrast, period_s, what in (
        (1.0, 1.0, "contrast"),
        (4.0, 0.0, "period"),
        (None, 1, "contr"),
    ):
        with pytest.raises(EvsError, match=what):
            fit_camera([Light(few, "ramp", None, contrast, period_s)], BASE)
    with pytest.raises(EvsError, match=r"do not take turns|too short"):
        fit_camera([Light(few, "ramp", None, 4.0)], BASE)
    with pytest.raises(EvsError, match="nothing to fit"):
        fit_camera([], BASE)
    other = Observed(few.events, 5, 5, "other")
    with pytest.raises(EvsError, match="several sizes"):
        fit_camera([Light(few), Light(other)], BASE)
    with pytest.raises(EvsError, match="still-lux"):
        fit_still(few, -1.0)


def test_the_best_of_several_recordings_counts() -> None:
    found = combined([
        cannot("pos_thres", "a", "too dark"),
        Estimate("pos_thres", 0.2, 0.02, "b"),
        Estimate("pos_thres", 0.21, 0.01, "c"),
        cannot("cutoff_hz", "a", "no flank"),
        cannot("cutoff_hz", "b", "no lamp"),
    ])  # fmt: skip
    assert [one.source for one in found] == ["c", "a"]
    assert found[1].reason == "no flank; no lamp"


def test_the_file_says_where_each_value_comes_from(tmp_path) -> None:
    seen = lamps.ramp(3, pos_thres=0.21, neg_thres=0.17, sigma_thres=0.02, periods=4)
    found = fit_camera([Light(seen, "ramp", None, 4.0)], BASE)
    path = tmp_path / "mine.toml"
    path.write_text(sensor_toml(found, "davis346"))
    made = evs.Pixels(str(path)).sensor
    assert (made.width, made.height) == (lamps.WIDTH, lamps.HEIGHT)
    assert abs(made.pos_thres - 0.21) < 0.01
    assert made.cutoff_hz == BASE.cutoff_hz
    lines = path.read_text().splitlines()
    assert any(line.startswith("pos_thres = ") and "# fit: ramp, 0.2" in line for line in lines)
    assert any(line.startswith("cutoff_hz = ") and "davis346, not fitted" in line for line in lines)


@pytest.mark.statistical
@pytest.mark.parametrize("period_s", [2e-4, 1e-3])
def test_noise_tells_the_refractory_period(period_s: float) -> None:
    keys = {"pos_thres": 0.2, "neg_thres": 0.2, "hot_leak_median_hz": 0.02}
    noisy = keys | {"shot_noise_rate_hz": 8.0, "refractory_period_s": period_s}
    seen = lamps.dark(10.0, 5, **noisy)
    found = fit_camera([Light(seen, "dark", 0.0)], BASE)["refractory_period_s"]
    assert abs(found.number - period_s) < 3.0 * found.error < 0.2 * period_s
