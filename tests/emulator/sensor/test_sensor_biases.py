"""Biases: the nominal ones change nothing, others follow the law, and senseless ones are told."""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evs
from evs.emulator.config import SensorConfig
from evs.emulator.config.sensor import BiasConfig
from evs.emulator.sensor import PlainModel, preset_biases, preset_names, resolve_sensor
from evs.emulator.sensor.bias_laws import COARSE_PA, LAWS, Nominal, with_biases
from evs.emulator.sensor.presets import _PRESETS
from evs.msgs import EvsError

NAMES = tuple(field.name for field in fields(BiasConfig))
WITH_BIASES = [name for name in preset_names() if name not in ("ideal", "v2e")]
EVERY = {
    "pos_thres": 0.2,
    "neg_thres": 0.25,
    "cutoff_hz": 300.0,
    "follower_hz": 2000.0,
    "highpass_hz": 0.0,
    "leak_rate_hz": 0.1,
    "parasitic_leak_hz": 0.02,
    "refractory_period_s": 0.0005,
}
"""parameters of a made-up pixel in which everything is on"""

# bias -> the parameter that it is for, and whether that grows with it
EFFECTS = {
    "davis": {
        "PrBp": ("cutoff_hz", 1),
        "PrSFBp": ("follower_hz", 1),
        "ONBn": ("pos_thres", 1),
        "OFFBn": ("neg_thres", -1),
        "DiffBn": ("neg_thres", 1),
        "RefrBp": ("refractory_period_s", -1),
    },
    "dvs128": {
        "Pr": ("cutoff_hz", 1),
        "foll": ("follower_hz", 1),
        "diffOn": ("pos_thres", 1),
        "diffOff": ("neg_thres", -1),
        "diff": ("neg_thres", 1),
        "refr": ("refractory_period_s", -1),
    },
    "dvxplorer": {
        "bias_sensitivity": ("pos_thres", -1),
        "contrastThresholdOn": ("pos_thres", 1),
        "contrastThresholdOff": ("neg_thres", 1),
    },
    "imx636": {
        "bias_diff_on": ("pos_thres", 1),
        "bias_diff_off": ("neg_thres", 1),
        "bias_fo": ("follower_hz", 1),
        "bias_hpf": ("highpass_hz", 1),
        "bias_refr": ("refractory_period_s", -1),
    },
}
EFFECTS["genx320"] = EFFECTS["imx636"]


def every(name: str) -> dict[str, float]:
    """EVERY with the high pass that the preset's nominal bias makes."""
    biases = nominal(name)
    code = biases.values.get("bias_hpf", 0)
    return EVERY | {"highpass_hz": biases.law.highpass(code) if biases.law.highpass else 0.0}


def nominal(name: str) -> Nominal:
    biases = preset_biases(name)
    assert biases is not None
    return biases


def changed(name: str, *fixed: str, **given: int) -> dict[str, Any]:
    """EVERY under other biases."""
    return with_biases(every(name), nominal(name), given, fixed, name)


def refusal(preset: str, **given: Any) -> str:
    with pytest.raises(EvsError) as error:
        resolve_sensor(SensorConfig(preset, biases=BiasConfig(**given)))
    assert "\n" not in str(error.value)
    return str(error.value)


def current_pa(coarse: int, fine: int) -> float:
    return COARSE_PA[coarse] * fine / 255


@pytest.mark.parametrize("name", WITH_BIASES)
def test_nominal_biases_are_the_preset_bit_for_bit(name: str) -> None:
    values = dict(nominal(name).values)
    plain = resolve_sensor(SensorConfig(name))
    for key, value in values.items():
        assert resolve_sensor(SensorConfig(name, biases=BiasConfig(**{key: value}))) == plain
    # bias_sensitivity sets the other two, so the three are never given together
    values.pop("bias_sensitivity", None)
    assert resolve_sensor(SensorConfig(name, biases=BiasConfig(**values))) == plain
    assert changed(name, **values) == every(name)


def test_every_bias_belongs_to_a_preset_and_lies_in_its_range() -> None:
    of_presets = {key for name in WITH_BIASES for key in nominal(name).values}
    assert of_presets == set(NAMES)
    assert preset_biases("ideal") is None
    for name in WITH_BIASES:
        biases = nominal(name)
        assert list(biases.values) == [key for key in NAMES if key in biases.law.ranges]


def fires_for_ever(name: str, key: str, value: int) -> bool:
    """Whether the comparators' currents would not lie on both sides of the amplifier's."""
    now = {**nominal(name).values, key: value}
    if name == "dvs128":
        return not now["diffOff"] < now["diff"] < now["diffOn"]
    names = ("OFFBn", "DiffBn", "ONBn")
    off, diff, on = (current_pa(now[f"{n}_coarse"], now[f"{n}_fine"]) for n in names)
    return not off < diff < on


def law_of(name: str) -> str:
    return next(law for law in LAWS if LAWS[law] is nominal(name).law)


@pytest.mark.slow
@pytest.mark.parametrize("name", WITH_BIASES)
def test_a_bias_moves_its_parameter_one_way_over_its_whole_range(name: str) -> None:
    biases, before = nominal(name), every(name)
    for key, (lowest, highest) in biases.law.ranges.items():
        stem = key.removesuffix("_coarse").removesuffix("_fine")
        parameter, sign = EFFECTS[law_of(name)][stem]
        run = []
        for value in sorted({round(v) for v in np.geomspace(1, highest - lowest + 1, 200)}):
            value += lowest - 1
            if key.startswith(("ON", "OFF", "Diff", "diff")) and fires_for_ever(name, key, value):
                continue
            now = changed(name, **{key: value})
            run.append(sign * now[parameter])
            assert all(math.isfinite(other) and other >= 0 for other in now.values())
            others = {k: v for k, v in now.items() if k != parameter and v != before[k]}
            leaks = {"leak_rate_hz", "parasitic_leak_hz"}
            allowed = {"pos_thres", "neg_thres"} if "iff" in stem or "sens" in stem else set()
            assert set(others) <= allowed | leaks
        assert len(run) > 1
        assert all(a < b for a, b in itertools.pairwise(run)), key


def test_davis_thresholds_are_logarithms_of_current_ratios() -> None:
    now = changed("davis346", ONBn_coarse=6, ONBn_fine=200)
    diff, on = current_pa(4, 39), current_pa(5, 255)
    ratio = math.log(current_pa(6, 200) / diff) / math.log(on / diff)
    assert now["pos_thres"] == pytest.approx(0.2 * ratio, rel=1e-14)
    assert now["neg_thres"] == 0.25
    # the drift of a leaking pixel is what it was: the rate goes with one over the threshold
    assert now["leak_rate_hz"] == pytest.approx(0.1 / ratio, rel=1e-14)
    assert now["parasitic_leak_hz"] == pytest.approx(0.02 / ratio, rel=1e-14)
    now = changed("davis346", OFFBn_fine=10)
    ratio = math.log(diff / current_pa(4, 10)) / math.log(diff / current_pa(4, 1))
    assert now["neg_thres"] == pytest.approx(0.25 * ratio, rel=1e-14)
    assert now["leak_rate_hz"] == 0.1


def test_davis_speeds_go_with_the_current() -> None:
    now = changed("davis346", PrBp_fine=116, PrSFBp_fine=4, RefrBp_fine=5)
    assert now["cutoff_hz"] == pytest.approx(600.0, rel=1e-14)
    assert now["follower_hz"] == pytest.approx(500.0, rel=1e-14)
    assert now["refractory_period_s"] == pytest.approx(0.0025, rel=1e-14)
    decade = changed("davis346", PrBp_coarse=3)["cutoff_hz"] / 300.0
    assert decade == pytest.approx(6054 / 756, rel=1e-14)


def test_dvs128_follows_the_same_law_on_its_own_codes() -> None:
    now = changed("dvs128", diff=20000, Pr=434, refr=323)
    on = math.log(209996 / 20000) / math.log(209996 / 13125)
    off = math.log(20000 / 132) / math.log(13125 / 132)
    assert now["pos_thres"] == pytest.approx(0.2 * on, rel=1e-14)
    assert now["neg_thres"] == pytest.approx(0.25 * off, rel=1e-14)
    assert (now["cutoff_hz"], now["refractory_period_s"]) == pytest.approx((600.0, 0.0015))


def test_imx636_thresholds_are_linear_in_the_code_and_reach_the_lowest() -> None:
    lowest = changed("imx636", bias_diff_on=-85)["pos_thres"]
    assert lowest == pytest.approx(0.2 * math.log(1.11) / math.log(1.25), rel=1e-14)
    at = [changed("imx636", bias_diff_on=code)["pos_thres"] for code in (-40, 20, 80)]
    assert at[1] - at[0] == pytest.approx(at[2] - at[1], rel=1e-12)
    on, off = (changed("imx636", **{f"bias_diff_{p}": 60}) for p in ("on", "off"))
    assert on["pos_thres"] / 0.2 == pytest.approx(off["neg_thres"] / 0.25, rel=1e-14)


def test_prophesees_filters() -> None:
    slow, fast = (changed("imx636", bias_fo=code)["follower_hz"] for code in (-35, 55))
    assert fast / slow == pytest.approx(10.0, rel=1e-14)
    slow, fast = (changed("genx320", bias_fo=code)["follower_hz"] for code in (19, 39))
    assert fast / slow == pytest.approx(10.0, rel=1e-14)
    assert changed("imx636", bias_hpf=120)["highpass_hz"] == pytest.approx(100.0, rel=1e-14)
    assert changed("imx636", bias_hpf=40)["highpass_hz"] == pytest.approx(1.0, rel=1e-14)
    assert changed("genx320", bias_hpf=0)["highpass_hz"] == 0.0
    assert changed("imx636", bias_refr=21)["refractory_period_s"] == pytest.approx(0.00025)
    assert changed("genx320", bias_refr=0)["refractory_period_s"] == pytest.approx(0.0055)


@pytest.mark.parametrize(("level", "code"), list(enumerate((15, 12, 9, 5, 2))))
def test_dvxplorers_sensitivity_is_a_short_name_of_two_thresholds(level: int, code: int) -> None:
    short = changed("dvxplorer", bias_sensitivity=level)
    assert short == changed("dvxplorer", contrastThresholdOn=code, contrastThresholdOff=code)
    assert short["pos_thres"] == pytest.approx(0.2 * (9 + code) / 18, rel=1e-14)


@pytest.mark.parametrize("name", ["imx636", "genx320"])
def test_the_presets_high_pass_is_what_its_bias_makes(name: str) -> None:
    biases = nominal(name)
    assert biases.law.highpass is not None
    made = biases.law.highpass(biases.values["bias_hpf"])
    assert resolve_sensor(SensorConfig(name)).highpass_hz == made


def test_a_parameter_that_is_given_wins_over_the_biases() -> None:
    biases = BiasConfig(bias_diff_on=50, bias_diff_off=50)
    both = resolve_sensor(SensorConfig("imx636", biases=biases))
    one = resolve_sensor(SensorConfig("imx636", pos_thres=0.3, biases=biases))
    # and the leak, which goes with the threshold, is the preset's then
    leaks = {"leak_rate_hz": 0.015, "parasitic_leak_hz": 0.06, "hot_leak_median_hz": 0.0045}
    assert one == replace(both, pos_thres=0.3, **leaks)
    assert both.pos_thres != resolve_sensor(SensorConfig("imx636")).pos_thres
    # a threshold that no bias moves leaves the leak alone, too
    assert changed("imx636", "pos_thres", bias_diff_on=50) == EVERY
    assert changed("imx636", "highpass_hz", bias_hpf=50) == EVERY


def test_a_threshold_under_the_pixels_lowest_tells_that_a_bias_made_it(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    text = (_PRESETS / "imx636.toml").read_text()
    own.write_text(text.replace("pos_thres = 0.223", "pos_thres = 0.0011"))
    said = refusal(str(own), bias_diff_on=-85)
    assert "sensor.pos_thres is 0.000514" in said
    assert "(sensor.biases has changed the preset)" in said


@pytest.mark.parametrize(
    ("preset", "given", "said"),
    [
        ("davis346", {"bias_fo": 1}, "no bias of sensor davis346 'bias_fo'; there is: "),
        ("imx636", {"contrastThresholdOn": 1}, "'contrastThresholdOn'; there is: bias_"),
        ("ideal", {"bias_fo": 1}, "sensor ideal has no biases; leave out sensor.biases.bias_fo"),
        ("imx636", {"bias_fo": 56}, "sensor.biases.bias_fo is 56; give a whole number, -35 ... 55"),
        ("imx636", {"bias_fo": -36}, "sensor.biases.bias_fo is -36; give"),
        ("genx320", {"bias_diff_on": 23}, "sensor.biases.bias_diff_on is 23; give"),
        ("davis346", {"PrBp_coarse": 8}, "sensor.biases.PrBp_coarse is 8; give"),
        (
            "davis346",
            {"PrBp_fine": 0},
            "sensor.biases.PrBp_fine is 0; give a whole number, 1 ... 255",
        ),
        ("davis346", {"PrBp_fine": 1.5}, "sensor.biases.PrBp_fine is 1.5; give a whole number"),
        ("davis346", {"PrBp_fine": True}, "sensor.biases.PrBp_fine is True; give a whole number"),
        ("davis346", {"ONBn_coarse": 2}, "OFFBn (189.949) < DiffBn (7408.01) < ONBn (756)"),
        ("davis240", {"OFFBn_fine": 39}, "raise ONBn, or lower OFFBn, until it does"),
        ("dvs128", {"diffOn": 13125}, "diffOff (132) < diff (13125) < diffOn (13125)"),
        (
            "dvxplorer",
            {"bias_sensitivity": 2, "contrastThresholdOff": 9},
            "bias_sensitivity and contrastThresholdOff set the same threshold; give one of them",
        ),
    ],
)
def test_refusals(preset: str, given: dict[str, Any], said: str) -> None:
    assert said in refusal(preset, **given)


def test_an_own_file_may_have_a_law_and_nominal_values_of_its_own(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    pixels = "width = 20\nheight = 10\npos_thres = 0.5\nneg_thres = 0.5\n"
    biases = dict(asdict(BiasConfig()), **nominal("dvxplorer").values)
    table = "".join(f"{k} = {v}\n" for k, v in biases.items() if v is not None)
    own.write_text(f'{pixels}[biases]\nlaw = "dvxplorer"\n{table.replace("On = 9", "On = 0")}')
    plain = resolve_sensor(SensorConfig(str(own)))
    assert (plain.pos_thres, plain.neg_thres) == (0.5, 0.5)
    given = BiasConfig(contrastThresholdOn=9)
    assert resolve_sensor(SensorConfig(str(own), biases=given)).pos_thres == pytest.approx(1.0)

    for text, said in (
        ("biases = 3\n", "biases is 3; make it a table [biases]"),
        ('[biases]\nlaw = "dvxplor"\n', "there is: dvxplorer"),
        ("[biases]\n", "no biases.law in sensor file"),
        ('[biases]\nlaw = "imx636"\nbias_fo = 1\n', "lacks biases.bias_diff_on; law imx636"),
        ('[biases]\nlaw = "imx636"\nbias_fi = 1\n', "no bias of law imx636 'bias_fi'; there is: b"),
        ('[biases]\nlaw = "imx636"\nbias_fo = "x"\n', "biases.bias_fo in sensor file"),
    ):
        own.write_text(pixels + text)
        assert said in refusal(str(own))


def test_the_python_face_has_them() -> None:
    assert evs.BiasConfig is BiasConfig
    sensor = evs.SensorConfig("imx636", 8, 6, biases=evs.BiasConfig(bias_diff_on=40))
    assert resolve_sensor(sensor).pos_thres > resolve_sensor(SensorConfig("imx636")).pos_thres


def counts(preset: str, **given: int) -> tuple[int, int]:
    """ON and OFF events of 12 x 10 pixels while light doubles and halves for 0.4 s."""
    config = SensorConfig(preset, width=12, height=10, biases=BiasConfig(**given))
    model = PlainModel(resolve_sensor(config), 1)
    state = model.init(1)
    on = off = 0
    for tick in range(400):
        light = np.full((10, 12), 0.5 * 2.0 ** math.sin(tick * math.pi / 50), np.float32)
        events, state = model.step(light, state, 1000 * tick - 1000, 1000 * tick)
        on += int(np.count_nonzero(events["p"] == 1))
        off += int(np.count_nonzero(events["p"] == 0))
    return on, off


@pytest.mark.parametrize(
    ("preset", "less", "more"),
    [
        ("davis346", {"ONBn_coarse": 6}, {"ONBn_coarse": 4}),
        ("dvs128", {"diffOn": 2_000_000}, {"diffOn": 40_000}),
        ("imx636", {"bias_diff_on": 140}, {"bias_diff_on": -85}),
        ("genx320", {"bias_diff_on": 60}, {"bias_diff_on": 24}),
        ("dvxplorer", {"contrastThresholdOn": 17}, {"contrastThresholdOn": 0}),
    ],
)
def test_events_answer_to_the_biases(
    preset: str, less: dict[str, int], more: dict[str, int]
) -> None:
    (on, off), fewer, further = counts(preset), counts(preset, **less), counts(preset, **more)
    assert fewer[0] < on < further[0]
    # a reference that ON events move less often gives OFF events less often too
    assert fewer[1] <= off


def test_slow_biases_blur_the_light_away() -> None:
    fast = sum(counts("imx636", bias_fo=55))
    assert sum(counts("davis346", PrSFBp_coarse=0, PrSFBp_fine=1)) < sum(counts("davis346")) / 10
    assert sum(counts("imx636", bias_hpf=120)) < fast / 2
