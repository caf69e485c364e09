"""The sensor file of a fitted camera: what was fitted, and the base for the rest, each marked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from evs.emulator.config import SensorConfig
from evs.emulator.sensor.presets import DEFAULT, describe_sensor, flat, resolve_sensor
from evs_lab.fit.camera import FittedCamera
from evs_lab.fit.estimate import Estimate

WHOLE = ("readout.scan_us", "readout.scan_column_ns")
TABLES = ("readout", "aps", "imu")


def sensor_toml(fitted: FittedCamera, base: str) -> str:
    """The text of a sensor file.

    Args:
        fitted: The camera.
        base: The preset or file that the other values come from.

    Raises:
        EvsError: There is no such base.
    """
    described = describe_sensor(SensorConfig(base))
    values = {one.key: (one.value, one.source) for one in described.parameters}
    defaults = dict(flat(resolve_sensor(SensorConfig(base))))
    seen = fitted.lights[0].seen
    lines: dict[str, tuple[Any, str]] = {}
    for key, (value, source) in values.items():
        if source != DEFAULT:
            lines[key] = value, f"{base}, not fitted: {source}"
    lines["width"] = seen.width, f"fit: {seen.source}"
    lines["height"] = seen.height, f"fit: {seen.source}"
    for key, estimate in fitted.told.items():
        lines[key] = _value(estimate), _comment(estimate)
    for key, value, reason in _follows(fitted):
        if lines.get(key, (defaults.get(key), ""))[0] != value:
            lines[key] = value, reason
    return "\n".join(_text(fitted, base, lines)) + "\n"


def _follows(fitted: FittedCamera) -> Iterator[tuple[str, Any, str]]:
    """Values that would count twice beside a fitted one."""
    told = fitted.told
    if "photocurrent_pa" in told:
        yield "shot_noise_rate_hz", 0.0, "fit: the noise is in photocurrent_pa"
    elif "shot_noise_rate_hz" in told:
        yield "photocurrent_pa", 0.0, "fit: the noise is in shot_noise_rate_hz"
    if "leak_rate_hz" in told and "hot_leak_median_hz" not in told:
        yield "hot_leak_median_hz", 0.0, "fit: what tail there is, is in leak_rate_hz"
    if "leak_rate_hz" in told and not any(one.kind in ("dark", "still") for one in fitted.lights):
        yield "parasitic_leak_hz", 0.0, "fit: what the light adds is in leak_rate_hz"
    if "cutoff_hz" in told:
        yield "follower_hz", 0.0, "fit: one pole was fitted, cutoff_hz"


def _text(fitted: FittedCamera, base: str, lines: dict[str, tuple[Any, str]]) -> Iterator[str]:
    names = ", ".join(dict.fromkeys(one.seen.source for one in fitted.lights))
    yield f"# Fitted by evs fit to {names}; what they do not tell is that of {base}."
    yield "# The values are those of the biases with which they were recorded."
    for table in ("", *TABLES):
        inside = {
            key.rpartition(".")[2]: line
            for key, line in lines.items()
            if key.rpartition(".")[0] == table
        }
        if not inside:
            continue
        if table:
            yield ""
            yield f"[{table}]"
        for key, (value, comment) in inside.items():
            yield f"{key} = {_toml(value)} # {comment}"


def _value(estimate: Estimate) -> Any:
    if isinstance(estimate.value, str):
        return estimate.value
    if estimate.key in WHOLE:
        return round(estimate.value)
    return float(rounded(estimate.value, estimate.error))


def _comment(estimate: Estimate) -> str:
    found = f"fit: {estimate.source}"
    if not isinstance(estimate.value, str):
        value, error = rounded(estimate.value, estimate.error), f"{estimate.error:.2g}"
        found += f", {value} +- {error}"
    return f"{found}; {estimate.note}" if estimate.note else found


def rounded(value: float, error: float) -> str:
    """A value with as many digits as two digits of its error have."""
    if not math.isfinite(error) or error <= 0.0 or value == 0.0:
        return f"{value:.6g}"
    digits = max(2, math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 2)
    return f"{value:.{min(digits, 9)}g}"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return repr(value)
