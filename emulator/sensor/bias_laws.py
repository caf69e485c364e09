"""Biases: the knobs of a real chip, by its drivers' names, as parameters of the pixel.

A preset has a table [biases]: `law`, the chip whose law holds, and the nominal value of every bias.
With nominal biases the parameters are the preset's own, bit for bit; another value scales them by
the law. A parameter that the configuration gives itself wins over the biases.

A law turns the biases into positive numbers, one for each parameter of the pixel, that the
parameter is in proportion to: parameter = preset's value * law(biases) / law(preset's biases).
All of it is decimal arithmetic of 34 digits, so that every machine gets the same parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from types import MappingProxyType
from typing import Any

from evs.msgs import EvsError, unknown

LEAKS = ("leak_rate_hz", "parasitic_leak_hz", "hot_leak_median_hz")
"""rates of a drift that no bias changes: a higher ON threshold is reached less often"""


@dataclass(frozen=True)
class Nominal:
    """The biases that a sensor has."""

    law: Law
    values: Mapping[str, int]
    """bias -> its nominal value"""


def nominal_biases(table: Mapping[str, Any], where: str) -> Nominal:
    """Check the [biases] of a preset.

    Args:
        table: The table.
        where: The file, for messages.

    Raises:
        EvsError: No such law or bias, a value out of its range, or a bias that is missing.
    """
    values = {key: value for key, value in table.items() if key != "law"}
    name = table.get("law", "")
    if name not in LAWS:
        raise unknown(f"biases.law in sensor file {where}", str(name), LAWS)
    law = LAWS[name]
    for key, value in values.items():
        _check(law, key, value, f"biases.{key} in sensor file {where}", f"law {name}")
    missing = [key for key in law.ranges if key not in values]
    if missing:
        raise EvsError(f"sensor file {where} lacks biases.{missing[0]}; law {name} needs it")
    law.scales(values)
    return Nominal(law, values)


def with_biases(
    parameters: Mapping[str, Any],
    nominal: Nominal | None,
    given: Mapping[str, int],
    fixed: Collection[str],
    sensor: str,
) -> dict[str, Any]:
    """Apply biases other than the nominal ones to the parameters of a preset.

    Args:
        parameters: Those of the preset.
        nominal: Its biases; None: it has none.
        given: Bias -> value.
        fixed: Parameters that stay as they are.
        sensor: Its name, for messages.

    Raises:
        EvsError: A bias that the sensor does not have, or out of its range, or that no pixel works
            with.
    """
    changed = dict(parameters)
    if nominal is None:
        for name in given:
            raise EvsError(f"sensor {sensor} has no biases; leave out sensor.biases.{name}")
        return changed
    law = nominal.law
    for name, value in given.items():
        _check(law, name, value, f"sensor.biases.{name}", f"sensor {sensor}")
    biases = effective(nominal, given)
    if biases == nominal.values:
        return changed

    with localcontext(EXACT):
        before, after = law.scales(nominal.values), law.scales(biases)
        factors = {key: after[key] / before[key] for key in after}
        for leak in LEAKS:
            factors[leak] = Decimal(1) if "pos_thres" in fixed else 1 / factors["pos_thres"]
        for key, factor in factors.items():
            if key not in fixed and factor != 1 and type(changed.get(key)) in (int, float):
                changed[key] = float(Decimal(changed[key]) * factor)
    if law.highpass and "highpass_hz" not in fixed:
        code = biases["bias_hpf"]
        if code != nominal.values["bias_hpf"]:
            changed["highpass_hz"] = law.highpass(code)
    return changed


def effective(nominal: Nominal, given: Mapping[str, int]) -> dict[str, int]:
    """Every bias of a sensor, with what is given; bias_sensitivity sets two others."""
    return {**nominal.values, **given, **_levels(given)}


def _levels(given: Mapping[str, int]) -> dict[str, int]:
    if "bias_sensitivity" not in given:
        return {}
    names = ("contrastThresholdOn", "contrastThresholdOff")
    both = [name for name in names if name in given]
    if both:
        raise EvsError(
            f"sensor.biases.bias_sensitivity and {both[0]} set the same threshold; give one of them"
        )
    return dict.fromkeys(names, LEVELS[given["bias_sensitivity"]])


def _check(law: Law, name: str, value: Any, key: str, owner: str) -> None:
    if name not in law.ranges:
        raise unknown(f"bias of {owner}", name, law.ranges)
    lowest, highest = law.ranges[name]
    if not isinstance(value, int) or isinstance(value, bool) or not lowest <= value <= highest:
        raise EvsError(f"{key} is {value!r}; give a whole number, {lowest} ... {highest}")


EXACT = Context(prec=34)

Biases = Mapping[str, int]
Scales = dict[str, Decimal]

COARSE_PA = (11, 94, 756, 6054, 48437, 387500, 3100000, 24800000)
"""pA at fine 255 for the coarse values of a DAVIS, as libcaer's davis.c has them"""

LEVELS = (15, 12, 9, 5, 2)
"""contrastThresholdOn and Off of a DVXplorer's bias_sensitivity: the registers that libcaer's
dvxplorer.c writes for each level, counted as dv-processing counts them"""


@dataclass(frozen=True)
class Law:
    """The biases of one chip."""

    ranges: Mapping[str, tuple[int, int]]
    """bias -> lowest and highest value, both allowed"""
    scales: Callable[[Biases], Scales]
    """all biases -> what each parameter is in proportion to. Raises EvsError."""
    highpass: Callable[[int], float] | None = None
    """bias_hpf -> highpass_hz"""


def current_pa(biases: Biases, name: str) -> Decimal:
    """pA of a coarse-fine bias: coarse picks the decade, fine divides it by 255."""
    return Decimal(COARSE_PA[biases[f"{name}_coarse"]] * biases[f"{name}_fine"]) / 255


def _thresholds(on: Decimal, diff: Decimal, off: Decimal, names: tuple[str, str, str]) -> Scales:
    """theta is in proportion to the logarithm of the comparator's over the amplifier's current.

    Nozaki and Delbruck, IEEE TED 64(8), 2017, as jAER's DavisConfig applies it.
    """
    if not off < diff < on:
        text = " < ".join(
            f"{n} ({float(c):g})" for n, c in zip(names, (off, diff, on), strict=True)
        )
        raise EvsError(
            f"sensor.biases: the pixel would fire for ever, {text} does not hold; "
            f"raise {names[2]}, or lower {names[0]}, until it does"
        )
    return {"pos_thres": EXACT.ln(on / diff), "neg_thres": EXACT.ln(diff / off)}


def _davis(biases: Biases) -> Scales:
    on, diff, off = (current_pa(biases, name) for name in ("ONBn", "DiffBn", "OFFBn"))
    return {
        **_thresholds(on, diff, off, ("OFFBn", "DiffBn", "ONBn")),
        # a stage in subthreshold: f = I / (2 pi U_T C)
        "cutoff_hz": current_pa(biases, "PrBp"),
        "follower_hz": current_pa(biases, "PrSFBp"),
        # the reset node's capacitor, charged by a constant current
        "refractory_period_s": 1 / current_pa(biases, "RefrBp"),
    }


def _dvs128(biases: Biases) -> Scales:
    on, diff, off = (Decimal(biases[name]) for name in ("diffOn", "diff", "diffOff"))
    return {
        **_thresholds(on, diff, off, ("diffOff", "diff", "diffOn")),
        "cutoff_hz": Decimal(biases["Pr"]),
        "follower_hz": Decimal(biases["foll"]),
        "refractory_period_s": 1 / Decimal(biases["refr"]),
    }


def _dvxplorer(biases: Biases) -> Scales:
    # guess: the codes step the logarithm of the comparator's current evenly, as the two ranges of
    # nine codes side by side suggest, and the lowest has half the threshold of the default, 9
    return {
        "pos_thres": Decimal(9 + biases["contrastThresholdOn"]),
        "neg_thres": Decimal(9 + biases["contrastThresholdOff"]),
    }


def _imx636(biases: Biases) -> Scales:
    # a code steps the logarithm of a current, so theta is linear in it (Prophesee, Biases: the
    # sensitivity is the difference of codes). guess: the slope, from the nominal 25 % at 0 to the
    # chip's lowest, 11 % (Finateu, ISSCC 2020), at the lowest bias_diff_on
    nominal, lowest = EXACT.ln(Decimal("1.25")), EXACT.ln(Decimal("1.11"))
    slope = (nominal - lowest) / 85
    return {
        "pos_thres": nominal + slope * biases["bias_diff_on"],
        "neg_thres": nominal + slope * biases["bias_diff_off"],
        # the source follower's bias. guess: the whole range of 90 is a factor of ten, as latency
        # varies with the biases (SPIE 13045, 130450P, 2024)
        "follower_hz": EXACT.power(10, Decimal(biases["bias_fo"]) / 90),
        # inversely to the current; OpenEB's register map: 20 is the code at 0. guess: + 1, so that
        # the lowest code still ends
        "refractory_period_s": 1 / Decimal(21 + biases["bias_refr"]),
    }


def _genx320(biases: Biases) -> Scales:
    return {
        # guess: in proportion to the code, which counts from no threshold at all
        "pos_thres": Decimal(biases["bias_diff_on"]),
        "neg_thres": Decimal(biases["bias_diff_off"]),
        # guess: the recommended range of 20 is a factor of ten, as on the IMX636
        "follower_hz": EXACT.power(10, Decimal(biases["bias_fo"]) / 20),
        # guess: inversely to the current, which the code counts from 1
        "refractory_period_s": 1 / Decimal(1 + biases["bias_refr"]),
    }


def _highpass(code: int) -> float:
    """guess: 0 is off, then a factor of ten in 40 codes from 0.1 Hz on; 100 Hz at 120."""
    return float(EXACT.power(10, Decimal(code) / 40) / 10) if code else 0.0


def _law(
    ranges: dict[str, tuple[int, int]],
    scales: Callable[[Biases], Scales],
    highpass: Callable[[int], float] | None = None,
) -> Law:
    return Law(MappingProxyType(ranges), scales, highpass)


LAWS = {
    # libcaer's davis.h; fine 0 is off
    "davis": _law(
        {
            f"{name}_{part}": (0, 7) if part == "coarse" else (1, 255)
            for name in ("PrBp", "PrSFBp", "DiffBn", "ONBn", "OFFBn", "RefrBp")
            for part in ("coarse", "fine")
        },
        _davis,
    ),
    # 24-bit shares of the master current; 0 is off
    "dvs128": _law(
        dict.fromkeys(("Pr", "foll", "diff", "diffOn", "diffOff", "refr"), (1, 2**24 - 1)),
        _dvs128,
    ),
    # dv-processing's DVXplorer; the ROS drivers' bias_sensitivity
    "dvxplorer": _law(
        {
            "bias_sensitivity": (0, 4),
            "contrastThresholdOn": (0, 17),
            "contrastThresholdOff": (0, 17),
        },
        _dvxplorer,
    ),
    # OpenEB's imx636_bias_settings.h: offsets from the factory's value
    "imx636": _law(
        {
            "bias_diff_on": (-85, 140),
            "bias_diff_off": (-35, 190),
            "bias_fo": (-35, 55),
            "bias_hpf": (0, 120),
            "bias_refr": (-20, 235),
        },
        _imx636,
        _highpass,
    ),
    # OpenEB's genx320_bias_settings.h, recommended values
    "genx320": _law(
        {
            "bias_diff_on": (24, 60),
            "bias_diff_off": (19, 50),
            "bias_fo": (19, 39),
            "bias_hpf": (0, 127),
            "bias_refr": (0, 127),
        },
        _genx320,
        _highpass,
    ),
}
"""chip -> its law"""
