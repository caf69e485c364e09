"""Biases: the knobs of a real chip, by its drivers' names, as parameters of the pixel.

A preset has a table [biases]: `law`, the chip whose law holds (bias_laws.py), and the nominal value
of every bias. With nominal biases the parameters are the preset's own, bit for bit; another value
scales them by the law. A parameter that the configuration gives itself wins over the biases.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from decimal import Decimal, localcontext
from typing import Any

from evs.emulator.sensor.presets.bias_laws import EXACT, LAWS, LEVELS, Law
from evs.msgs import EvsError, unknown

LEAKS = ("leak_rate_hz", "parasitic_leak_hz")
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
