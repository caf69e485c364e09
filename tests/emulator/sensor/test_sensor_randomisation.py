"""Randomised sensors: draws are pure, independent, in range, and what is recorded is what ran."""

from __future__ import annotations

import math
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import evs
from evs.emulator.base.scene import F32
from evs.emulator.config import ApsConfig, BiasConfig, ReadoutConfig, SensorConfig
from evs.emulator.config.sensor import PixelKeys, ReadoutKeys
from evs.emulator.sensor import PlainModel, resolve_sensor
from evs.emulator.sensor.random import Term
from evs.emulator.sensor.randomisation import (
    TERM,
    SensorRanges,
    keys_of,
    nominal_values,
    randomise_sensor,
    sensor_with_values,
)
from evs.msgs import EvsError, join_events

RANGES = {
    "pos_thres": "uniform(0.15, 0.35)",
    "cutoff_hz": "log_uniform(50, 500)",
    "sigma_thres": "normal(0.03, 0.01)",
    "readout.scan_us": "choice(100, 200, 400)",
    "white_lux": "log_uniform(1, 1e5)",
}
EPISODES = 2000


def draws(text: str, key: str = "pos_thres", sensor: Any = "davis346") -> np.ndarray:
    """The values of a key in many episodes."""
    ranges = SensorRanges({key: text}, sensor)
    return np.array([ranges.draw(3, episode).values[key] for episode in range(EPISODES)])


def test_a_draw_follows_from_seed_and_episode_alone() -> None:
    ranges = SensorRanges(RANGES)
    first = ranges.draw(7, 3)
    # other draws before it, another object, the function of the package
    ranges.draw(8, 1)
    again = SensorRanges(dict(RANGES)).draw(7, 3)
    assert first == again
    assert first.config == randomise_sensor("davis346", RANGES, seed=7, episode=3)
    assert first.config == evs.randomise_sensor("davis346", RANGES, seed=7, episode=3)
    assert first.config == sensor_with_values("davis346", first.values)
    assert ranges.draw(7 + 2**64, 3).values == first.values
    for other in (ranges.draw(7, 4), ranges.draw(8, 3)):
        differ = [key for key in RANGES if other.values[key] != first.values[key]]
        # a choice of three may be the same again
        assert set(RANGES) - set(differ) <= {"readout.scan_us"}


def test_values_that_were_written_down() -> None:
    # a change of these changes every randomised data set that is made again
    drawn = randomise_sensor("davis346", RANGES, seed=1, episode=2)
    found = (drawn.pos_thres, drawn.cutoff_hz, drawn.sigma_thres, drawn.white_lux)
    assert found == (0.287622, 96.4143, 0.0318863, 25628.2)
    assert drawn.readout.scan_us == 100


def test_neither_the_order_of_the_keys_nor_other_keys_change_a_draw() -> None:
    all_values = SensorRanges(RANGES).draw(5, 1).values
    backwards = SensorRanges(dict(reversed(RANGES.items()))).draw(5, 1)
    assert backwards.values == all_values
    for key, text in RANGES.items():
        assert SensorRanges({key: text}).draw(5, 1).values == {key: all_values[key]}


def test_every_key_has_numbers_of_its_own() -> None:
    numbers = {zlib.crc32(key.encode()) for key in keys_of(SensorConfig("davis346"))}
    assert len(numbers) == len(keys_of(SensorConfig("davis346"))) > 50
    assert TERM not in set(Term)


@pytest.mark.statistical
def test_keys_and_episodes_are_uncorrelated() -> None:
    names = ("pos_thres", "neg_thres", "dark_lux", "readout.row_ns", "latency_us")
    ranges = SensorRanges(
        dict.fromkeys(names, "uniform(1, 10)") | {"readout.row_ns": "uniform(0, 1000000)"}
    )
    found = np.array([list(ranges.draw(2, episode).values.values()) for episode in range(EPISODES)])
    # of independent numbers r has the standard deviation 1 / sqrt(n); 20 + 5 of them, 4.5 sigma
    bound = 4.5 / math.sqrt(EPISODES)
    across = np.corrcoef(found.T)[np.triu_indices(len(names), 1)]
    assert np.all(np.abs(across) < bound)
    along = [np.corrcoef(column[1:], column[:-1])[0, 1] for column in found.T]
    assert np.all(np.abs(along) < bound)


@pytest.mark.statistical
def test_distributions_have_their_moments_and_ends() -> None:
    def mean_near(values: np.ndarray, mean: float, variance: float) -> bool:
        return abs(values.mean() - mean) < 4.5 * math.sqrt(variance / len(values))

    def below(values: np.ndarray, edge: float, share: float) -> bool:
        return mean_near(values < edge, share, share * (1 - share))

    # 2000 numbers all miss the outer hundredth of a range once in 10^8 runs
    flat = draws("uniform(0.15, 0.35)")
    assert 0.15 <= flat.min() < 0.152 < 0.348 < flat.max() <= 0.35
    assert mean_near(flat, 0.25, 0.2**2 / 12)
    assert all(below(flat, 0.15 + 0.2 * share, share) for share in (0.1, 0.25, 0.5, 0.9))

    logarithmic = draws("log_uniform(1, 1e5)", "white_lux")
    assert 1 <= logarithmic.min() < 1.13 < 8.9e4 < logarithmic.max() <= 1e5
    assert mean_near(np.log10(logarithmic), 2.5, 25 / 12)
    assert all(below(logarithmic, 10.0**decade, decade / 5) for decade in (1, 2, 3, 4))

    bell = draws("normal(0.3, 0.02)")
    assert mean_near(bell, 0.3, 0.02**2)
    # the variance of a sample variance is 2 sigma^4 / n
    assert abs(bell.var() - 0.02**2) < 4.5 * math.sqrt(2 * 0.02**4 / EPISODES)

    # half a bell: mean sigma sqrt(2 / pi), variance sigma^2 (1 - 2 / pi)
    half = draws("normal(0, 0.1)", "sigma_thres")
    assert half.min() >= 0
    assert mean_near(half, 0.1 * math.sqrt(2 / math.pi), 0.01 * (1 - 2 / math.pi))

    chosen = draws("choice(100, 200, 400)", "readout.scan_us")
    assert set(chosen.tolist()) == {100, 200, 400}
    assert all(mean_near(chosen == one, 1 / 3, 2 / 9) for one in (100, 200, 400))

    whole = draws("uniform(3, 6)", "biases.PrBp_fine")
    assert set(whole.tolist()) == {3, 4, 5, 6}
    assert all(mean_near(whole == one, 1 / 4, 3 / 16) for one in (3, 4, 5, 6))


def test_factors_multiply_the_nominal_value_or_another_key() -> None:
    own = replace(SensorConfig("davis346"), leak_rate_hz=0.4, pos_thres=0.2)
    leaks = draws("uniform(0.5, 2) * nominal", "leak_rate_hz", own)
    assert 0.2 <= leaks.min() < 0.21 < 0.79 < leaks.max() <= 0.8
    # of a key that is not drawn
    fixed = draws("uniform(0.9, 1.1) * pos_thres", "neg_thres", own)
    assert 0.18 <= fixed.min() < fixed.max() <= 0.22
    ranges = SensorRanges(
        {"neg_thres": "uniform(0.9, 1.1) * pos_thres", "pos_thres": "uniform(0.15, 0.35)"}
    )
    pairs = [ranges.draw(1, episode).values for episode in range(200)]
    ratios = [pair["neg_thres"] / pair["pos_thres"] for pair in pairs]
    # values are rounded to six digits
    assert 0.9 - 1e-5 <= min(ratios) < 0.91 < 1.09 < max(ratios) <= 1.1 + 1e-5
    alone = SensorRanges({"pos_thres": "uniform(0.15, 0.35)"})
    for episode, pair in enumerate(pairs[:5]):
        assert alone.draw(1, episode).values["pos_thres"] == pair["pos_thres"]


def test_summands_are_added_to_the_nominal_value_or_another_key() -> None:
    own = replace(SensorConfig("davis346"), pos_thres=0.2)
    near = draws("uniform(-0.05, 0.05) + nominal", "pos_thres", own)
    assert 0.15 <= near.min() < 0.151 < 0.249 < near.max() <= 0.25
    ranges = SensorRanges(
        {"neg_thres": "choice(0.1) + pos_thres", "pos_thres": "uniform(0.15, 0.35)"}
    )
    for episode in range(20):
        values = ranges.draw(1, episode).values
        assert values["neg_thres"] == pytest.approx(values["pos_thres"] + 0.1, rel=1e-5)
    # a whole key stays whole, and a sum may be 0 or less where the key may
    whole = SensorRanges({"biases.bias_diff_on": "uniform(-20, -10) + nominal"}, "imx636")
    assert isinstance(whole.draw(1).values["biases.bias_diff_on"], int)


def test_biases_of_the_chip_are_drawn_too() -> None:
    ranges = SensorRanges({"biases.bias_diff_on": "uniform(-20, 20)"}, "imx636")
    drawn = ranges.draw(1)
    assert isinstance(drawn.values["biases.bias_diff_on"], int)
    assert drawn.config.biases.bias_diff_on == drawn.values["biases.bias_diff_on"]
    nominal = nominal_values(SensorConfig("imx636"))
    assert nominal["biases.bias_diff_on"] == 0
    assert resolve_sensor(drawn.config).pos_thres != nominal["pos_thres"]


def test_a_record_in_decimals_is_the_value_that_was_used() -> None:
    drawn = SensorRanges(RANGES).draw(4, 9)
    assert drawn.record == {"seed": 4, "episode": 9, "values": drawn.values}
    for value in drawn.values.values():
        assert float(f"{value:.6g}") == value


def test_every_numeric_key_may_have_a_range() -> None:
    keys = keys_of(SensorConfig("davis346"))
    declared = {
        *(name for name in vars(PixelKeys)["__dataclass_fields__"]),
        *(f"readout.{name}" for name in vars(ReadoutKeys)["__dataclass_fields__"]),
    }
    text = {"log", "filter", "shot_noise_law"}
    text |= {f"readout.{name}" for name in ("order", "erc_drop", "stamp", "mask_file")}
    lists = {"readout.roi", "readout.mask"}
    # another kind of value may come, but no number that is forgotten here
    left = declared - set(keys) - text - lists - {"width", "height"}
    numeric = [name for name in left if isinstance(nominal_values(SensorConfig()).get(name), float)]
    assert numeric == []
    assert {"exposure_dn", "white_lux", "dark_lux", "aps.exposure_us", "imu.rate_hz"} <= set(keys)
    assert "biases.bias_fo" not in keys
    assert "biases.bias_fo" in keys_of(SensorConfig("imx636"))


@pytest.mark.parametrize(
    ("key", "text", "says"),
    [
        ("pos_thrs", "uniform(1, 2)", "at randomise.pos_thrs: no numeric key of [sensor]; nearest"),
        ("log", "choice(1, 2)", "no numeric key of [sensor]"),
        ("width", "uniform(10, 20)", "one size in all episodes; set sensor.width"),
        ("biases.bias_fo", "uniform(1, 2)", "this sensor has no such bias; nearest known: biases"),
        ("pos_thres", 0.3, "0.3 is no distribution; write it as in 'uniform(0.15, 0.35)'"),
        ("pos_thres", "0.1 ... 0.3", "is no distribution"),
        ("pos_thres", "unifrm(1, 2)", "no distribution 'unifrm'; there is: uniform"),
        ("pos_thres", "uniform(a, b)", "'a, b' are no numbers"),
        ("pos_thres", "uniform(0.1, inf)", "are no numbers"),
        ("pos_thres", "uniform()", "are no numbers"),
        ("pos_thres", "uniform(0.3)", "give the lowest and the highest value"),
        ("pos_thres", "uniform(0.3, 0.1)", "give the lower value first"),
        ("dark_lux", "log_uniform(0, 1)", "both values must be over 0"),
        ("pos_thres", "normal(0.3)", "give the mean and the standard deviation"),
        ("pos_thres", "normal(0.3, 0)", "the standard deviation must be over 0"),
        ("pos_thres", "choice(0.3, 0.3)", "a value stands there twice"),
        ("pos_thres", "uniform(0, 1)", "0 is outside 0.001 ... 20, the range of the key"),
        ("sigma_thres", "normal(-1, 1)", "-1 is outside 0 ... 10"),
        ("sigma_thres", "normal(5, 1e6)", "hardly any of it lies in 0 ... 10"),
        ("pos_thres", "uniform(1, 200) * nominal", "is outside 0.001 ... 20"),
        ("readout.scan_us", "uniform(1.5, 2)", "its values are whole numbers"),
        ("pos_thres", "uniform(1, 2) * neg_thrs", "no factor 'neg_thrs'; nearest known: neg_thres"),
        ("pos_thres", "uniform(1, 2) * pos_thres", "no factor 'pos_thres'"),
        ("pos_thres", "uniform(0, 1) + neg_thrs", "no summand 'neg_thrs'; nearest known: neg_thr"),
        ("pos_thres", "uniform(-1, 0) + nominal", "is outside 0.001 ... 20"),
        ("pos_thres", "uniform(1, 2) * follower_hz", "a factor must be over 0"),
        ("aps.bits", "choice(8, 12)", "at randomise (aps.bits): sensor.aps.bits is 12"),
    ],
)
def test_mistakes_are_one_line(key: str, text: Any, says: str) -> None:
    sensor = replace(SensorConfig("davis346"), follower_hz=0.0)
    with pytest.raises(EvsError) as error:
        SensorRanges({key: text}, sensor)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_what_is_wrong_only_together_is_found_when_the_ranges_are_read() -> None:
    scan = replace(SensorConfig("davis346"), readout=ReadoutConfig(order="scan"))
    columns = r"346 columns take longer.*column_ns = 500, readout.scan_us = 100\)"
    with pytest.raises(EvsError, match=columns):
        SensorRanges(
            {
                "readout.scan_column_ns": "uniform(100, 500)",
                "readout.scan_us": "choice(100, 200, 400)",
            },
            scan,
        )
    # each alone would do, and so would both low or both high
    with pytest.raises(EvsError, match=r"ever.*DiffBn_fine = 240, biases.ONBn_fine = 100"):
        SensorRanges(
            {"biases.DiffBn_fine": "uniform(39, 240)", "biases.ONBn_fine": "uniform(100, 255)"},
            replace(SensorConfig("davis346"), biases=BiasConfig(ONBn_coarse=4)),
        )
    with pytest.raises(EvsError, match=r"cutoff_hz is 5.31429e\+09; .*PrBp_coarse = 7\)"):
        SensorRanges({"biases.PrBp_coarse": "normal(3.5, 7)"})
    frames = replace(SensorConfig("davis346"), aps=ApsConfig(enabled=True, rate_hz=25.0))
    with pytest.raises(EvsError, match="a frame takes"):
        SensorRanges({"aps.exposure_us": "uniform(1000, 90000)"}, frames)
    with pytest.raises(EvsError, match="pos_thres has a factor of its own"):
        SensorRanges(
            {
                "neg_thres": "normal(1, 0.1) * pos_thres",
                "pos_thres": "normal(1, 0.1) * sigma_thres",
                "sigma_thres": "uniform(0.1, 0.2)",
            }
        )


def test_wrong_arguments_are_one_line() -> None:
    with pytest.raises(EvsError, match="episode is -1"):
        SensorRanges(RANGES).draw(1, -1)
    with pytest.raises(EvsError, match="seed is 'a'"):
        SensorRanges(RANGES).draw("a")  # type: ignore[arg-type]
    with pytest.raises(EvsError, match="takes a name or a SensorConfig"):
        SensorRanges(RANGES, 3)  # type: ignore[arg-type]
    with pytest.raises(EvsError, match="randomise is 'a'"):
        SensorRanges("a")  # type: ignore[arg-type]
    with pytest.raises(EvsError, match="no numeric key of \\[sensor\\] 'pos_thrs'"):
        sensor_with_values("davis346", {"pos_thrs": 1.0})
    with pytest.raises(EvsError, match=r"sensor.pos_thres is 'a'; give a finite number"):
        sensor_with_values("davis346", {"pos_thres": "a"})  # type: ignore[dict-item]
    with pytest.raises(EvsError, match=r"sensor.readout.scan_us is 1.5; give a whole number"):
        sensor_with_values("davis346", {"readout.scan_us": 1.5})
    with pytest.raises(EvsError, match="the values are 3"):
        sensor_with_values("davis346", 3)  # type: ignore[arg-type]
    with pytest.raises(EvsError, match=r"at randomise.3: no numeric key"):
        SensorRanges({3: "uniform(1, 2)"})  # type: ignore[dict-item]


def light_of(tick: int) -> F32:
    """A bright edge that moves to the right, one pixel in 3 ticks."""
    columns = np.arange(32)
    row = np.where(columns < 4 + tick / 3, 0.8, 0.1) + 0.02 * np.sin(0.4 * tick + columns)
    return np.tile(row.astype(np.float32), (24, 1))


def events_of(config: SensorConfig, seed: int) -> bytes:
    """The events of this sensor in that light."""
    model = PlainModel(resolve_sensor(config), threads=1)
    state = model.init(seed)
    found = []
    for tick in range(30):
        events, state = model.step(light_of(tick), state, tick * 1000, (tick + 1) * 1000)
        found.append(events)
    return join_events(found).tobytes()


def test_the_recorded_values_give_the_events_again() -> None:
    base = replace(SensorConfig("davis346"), width=32, height=24)
    drawn = SensorRanges({**RANGES, "shot_noise_rate_hz": "log_uniform(0.1, 50)"}, base).draw(11, 2)
    first = events_of(drawn.config, 4)
    assert first == events_of(sensor_with_values(base, drawn.record["values"]), 4)
    assert len(first) > 100 * 16
    assert first != events_of(base, 4)
