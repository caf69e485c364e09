"""`evs sensors [NAME]`: list the sensors, or all parameters of one and their sources."""

from __future__ import annotations

import argparse
import dataclasses
import json
import textwrap
from typing import TYPE_CHECKING, Any

from evs.emulator.config import RunConfig, SensorConfig, decoding
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.emulator.sensor.presets import Bias, Description, Parameter

WIDTH = 110
"""columns of a page"""

EPILOG = """\
examples:
  evs sensors                                           all sensors, as a Markdown table
  evs sensors imx636                                    its parameters, their sources, its biases
  evs sensors davis346 sensor.biases.PrBp_fine=30       the effect of that bias on them
  evs sensors mine.toml --json                          your own file, as one JSON object
A * marks a value that a key or a bias has changed."""

COLUMNS = {
    "sensor": ("name", "{}"),
    "px": ("size", "{}"),
    "ON, OFF thresholds": ("thresholds", "{}"),
    "spread": ("sigma_thres", "{:g}"),
    "bandwidth, Hz": ("cutoff_hz", "{:g}"),
    "follower, Hz": ("follower_hz", "{:g}"),
    "leak, Hz": ("leak_rate_hz", "{:g}"),
    "leak by light, Hz": ("parasitic_leak_hz", "{:g}"),
    "hot tail, Hz": ("hot_leak_median_hz", "{:g}"),
    "photocurrent, pA": ("photocurrent_pa", "{:g}"),
    "noise in the dark, Hz": ("dark_noise_hz", "{:.2g}"),
    "refractory, s": ("refractory_period_s", "{:g}"),
    "dark current, lux": ("dark_lux", "{:g}"),
    "readout": ("readout", "{}"),
}
"""column of the table of all sensors -> (what it shows, how)"""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs sensors`."""
    parser.usage = "evs sensors [NAME or FILE.toml] [sensor.key=value ...] [--json]"
    parser.epilog = EPILOG
    parser.add_argument(
        "words",
        nargs="*",
        metavar="NAME, sensor.key=value",
        help="a sensor, and keys as for `evs emulate`",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead")


def run(args: argparse.Namespace) -> int:
    """Print every sensor, or one."""
    # here, so that --help is quick
    from evs.emulator.sensor import preset_names
    from evs.emulator.sensor.presets import describe_sensor

    names = [word for word in args.words if "=" not in word]
    if len(names) > 1:
        raise EvsError(f"two sensors, '{names[0]}' and '{names[1]}'; give one, then key=value")
    config = RunConfig(sensor=SensorConfig(preset=names[0]) if names else SensorConfig())
    keys = [decoding.split_word(word) for word in args.words if "=" in word]
    for key, _ in keys:
        if not key.startswith("sensor."):
            raise EvsError(f"{key} is not a sensor key; give keys that begin with sensor.")
    config = decoding.override(config, keys)
    if names or args.words:
        _print_one(describe_sensor(config.sensor), args.json)
        return 0
    every = [describe_sensor(SensorConfig(preset=name)) for name in preset_names()]
    if args.json:
        print(json.dumps([_plain(sensor) for sensor in every], indent=2))
    else:
        print("\n".join(table(every)))
    return 0


def table(sensors: list[Description]) -> list[str]:
    """The lines of a Markdown table, a row for each sensor."""
    rows = [list(COLUMNS), ["---"] * len(COLUMNS)]
    for sensor in sensors:
        shown = _shown(sensor)
        rows.append([_cell(shown.get(key), how) for key, how in COLUMNS.values()])
    return ["| " + " | ".join(row) + " |" for row in rows]


def _cell(value: Any, how: str) -> str:
    """Empty for a parameter that is off or that the sensor does not have."""
    return how.format(value) if value else "-"


def _shown(sensor: Description) -> dict[str, Any]:
    """What a row of the table can show."""
    values = {parameter.key: parameter.value for parameter in sensor.parameters}
    on, off = values["pos_thres"], values["neg_thres"]
    return values | {
        "name": sensor.name,
        "size": f"{values['width']} x {values['height']}",
        "readout": _readout(values),
        "thresholds": f"{on:.3g}" if on == off else f"{on:.3g}, {off:.3g}",
        "dark_noise_hz": _dark_noise_hz(sensor.name),
    }


def _dark_noise_hz(name: str) -> float:
    """Noise events of a pixel of a preset without light."""
    from evs.emulator.sensor import resolve_sensor
    from evs.emulator.sensor.noise_rate import noise_rate_hz

    return noise_rate_hz(resolve_sensor(SensorConfig(preset=name)), 0.0)


def _readout(values: dict[str, Any]) -> str:
    """How events leave, and at most how many."""
    order = str(values.get("readout.order", ""))
    most = values.get("readout.bandwidth_mevs")
    return f"{order}, {most:g} Mev/s" if most else order


def _print_one(sensor: Description, as_json: bool) -> None:
    if as_json:
        print(json.dumps(_plain(sensor), indent=2))
        return
    print(f"{sensor.name}: {sensor.about}" if sensor.about else sensor.name)
    for parameter in sensor.parameters:
        _print_line(parameter.key, _changed(parameter), _source(parameter))
    for bias in sensor.biases:
        mark = "" if bias.value == bias.nominal else "*"
        _print_line(f"biases.{bias.key}", f"{bias.value}{mark}", _range(bias))


def _print_line(key: str, value: str, source: str) -> None:
    """One line, and more where the source is long."""
    head = f"  {key:30} {value:10} "
    lines = textwrap.wrap(source, WIDTH - len(head)) or [""]
    print("\n".join([head + lines[0], *(" " * len(head) + line for line in lines[1:])]))


def _changed(parameter: Parameter) -> str:
    text = decoding.to_text(parameter.value)
    if isinstance(parameter.value, float):
        text = f"{parameter.value:.6g}"
    return text if parameter.value == parameter.preset else f"{text}*"


def _source(parameter: Parameter) -> str:
    if parameter.value == parameter.preset:
        return parameter.source
    return f"the preset: {decoding.to_text(parameter.preset)}"


def _range(bias: Bias) -> str:
    nominal = "" if bias.value == bias.nominal else f" (the preset: {bias.nominal})"
    return f"{bias.lowest} ... {bias.highest}{nominal}; {bias.source}"


def _plain(sensor: Description) -> dict[str, Any]:
    """As JSON: parameters and biases by name."""

    def rows(many: tuple[Parameter, ...] | tuple[Bias, ...]) -> dict[str, Any]:
        plain = [dataclasses.asdict(one) for one in many]
        return {one.pop("key"): one for one in plain}

    return {
        "name": sensor.name,
        "about": sensor.about,
        "parameters": rows(sensor.parameters),
        "biases": rows(sensor.biases),
    }
