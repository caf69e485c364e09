"""Config lint: settings of a sensor that are legal but unlikely to be intended."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

LEAST_THRESHOLD = 0.01
"""log units; v2e's floor, a tenth of what real pixels reach"""
MUCH_AT_FLOOR = 0.02
"""share of the pixels"""
LONG_BLIND_S = 0.1
"""real pixels are blind for some us to ms"""
SLOW_HZ = 1.0
"""real pixels are ten times as fast in starlight"""


def lint(camera: str, config: Mapping[str, Any]) -> list[str]:
    """Find the settings that are unlikely to be intended.

    Args:
        camera: Its name.
        config: Its configuration, with every number that its sensor really has.

    Returns:
        One line for each.
    """
    sensor = config.get("sensor", {})
    lines = list(_thresholds(sensor))
    if config.get("model", {}).get("name") != "evsnet":  # which takes nothing else of the sensor
        lines += [*_spread(sensor), *_slow(sensor)]
    return [f"camera '{camera}': {line}" for line in lines]


def _thresholds(sensor: Mapping[str, Any]) -> Iterator[str]:
    for keys, theta in _means(sensor):
        if theta < LEAST_THRESHOLD:
            yield (
                f"sensor.{keys} {theta:g}, so black to white is {math.log(255) / theta:,.0f} "
                "events per pixel; real sensors have 0.1 or more"
            )


def _spread(sensor: Mapping[str, Any]) -> Iterator[str]:
    sigma = sensor.get("sigma_thres") or 0.0
    for keys, theta in _means(sensor) if sigma else ():
        floor = min(LEAST_THRESHOLD, theta)
        share = 0.5 * math.erfc((theta - floor) / sigma / math.sqrt(2.0))
        if share > MUCH_AT_FLOOR:
            yield (
                f"sensor.sigma_thres is {sigma:g} and {keys} {theta:g}: {100 * share:.0f} % of "
                f"these thresholds are at the lowest, {floor:g}; lower sigma_thres"
            )


def _means(sensor: Mapping[str, Any]) -> list[tuple[str, float]]:
    """("pos_thres is", its mean), and of neg_thres; one of both where they are equal."""
    on, off = (sensor.get(key) for key in ("pos_thres", "neg_thres"))
    if on is None or off is None:
        return []
    if on == off:
        return [("pos_thres and neg_thres are", on)]
    return [("pos_thres is", on), ("neg_thres is", off)]


def _slow(sensor: Mapping[str, Any]) -> Iterator[str]:
    blind_s = sensor.get("refractory_period_s") or 0.0
    if blind_s >= LONG_BLIND_S:
        yield f"sensor.refractory_period_s: after each event a pixel is blind for {blind_s:g} s"
    for key in ("cutoff_hz", "follower_hz"):
        hz = sensor.get(key) or 0.0
        if 0.0 < hz < SLOW_HZ:
            yield (
                f"sensor.{key} is {hz:g}: a pixel follows the light {0.5 / math.pi / hz:.2g} s late"
            )
