"""Config lint: settings of a sensor that are legal but unlikely to be intended."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from evs.emulator.config.sensor import BRIGHTEST_DN, WHITE_DN

LEAST_THRESHOLD = 0.01
"""log units; v2e's floor, a tenth of what real pixels reach"""
MOST_THRESHOLD = 2.0
"""log units: seven times the light for one event; real pixels reach 0.6"""
LEAST_FOVY_DEG = math.pi
"""a view so narrow was hardly meant in degrees"""
MUCH_AT_FLOOR = 0.02
"""share of the pixels"""
LONG_BLIND_S = 0.1
"""real pixels are blind for some us to ms"""
SLOW_HZ = 1.0
"""real pixels are ten times as fast in starlight"""


def lint(
    camera: str,
    config: Mapping[str, Any],
    calibration: Mapping[str, Any] | None = None,
    mean_luminance: float = 0.0,
) -> list[str]:
    """Find the settings that are unlikely to be intended.

    Args:
        camera: Its name.
        config: Its configuration, with every number that its sensor really has.
        calibration: See `StreamInfo.camera_info`; None or empty without one.
        mean_luminance: Of its first picture.

    Returns:
        One line for each.
    """
    sensor = config.get("sensor", {})
    lines = [*_thresholds(sensor), *_view(calibration or {}), *_light(sensor, mean_luminance)]
    if config.get("model", {}).get("name") != "evsnet":  # which takes nothing else of the sensor
        lines += [*_spread(sensor), *_slow(sensor)]
    return [f"camera '{camera}': {line}" for line in lines]


def _thresholds(sensor: Mapping[str, Any]) -> Iterator[str]:
    for keys, theta in _means(sensor):
        if theta < LEAST_THRESHOLD:
            yield (
                f"sensor.{keys} {theta:g}, so a change from black to white gives "
                f"{math.log(255) / theta:,.0f} events per pixel; real sensors have 0.1 or more"
            )
        if theta > MOST_THRESHOLD:
            yield (
                f"sensor.{keys} {theta:g}, so one event takes {_times(theta)} the light; "
                "thresholds are in log units, and real sensors have 0.1 to 0.6"
            )


def _times(theta: float) -> str:
    return f"{math.exp(theta):,.0f} times" if theta < 7.0 else f"e^{theta:g} times"


def _view(calibration: Mapping[str, Any]) -> Iterator[str]:
    if not calibration or calibration.get("projection") == "orthographic":
        return
    fovy = math.degrees(2.0 * math.atan(0.5 * calibration["height"] / calibration["k"][4]))
    if fovy < LEAST_FOVY_DEG:
        yield (
            f"its vertical field of view is {fovy:.3g} degrees; if {fovy:.3g} are radians, give "
            f"fovy={math.degrees(fovy):.3g}"
        )


def _light(sensor: Mapping[str, Any], luminance: float) -> Iterator[str]:
    exposure_dn = sensor.get("exposure_dn") or WHITE_DN
    dn = luminance * exposure_dn
    if BRIGHTEST_DN < dn < math.inf:
        yield (
            f"its picture has a mean luminance of {luminance:.3g} ({dn:,.0f} DN, and 255 is "
            "white): make the lights weaker, or give "
            f"sensor.exposure_dn={0.4 * WHITE_DN / luminance:.2g}"
        )


def _spread(sensor: Mapping[str, Any]) -> Iterator[str]:
    sigma = sensor.get("sigma_thres") or 0.0
    for keys, theta in _means(sensor) if sigma else ():
        floor = min(LEAST_THRESHOLD, theta)
        share = 0.5 * math.erfc((theta - floor) / sigma / math.sqrt(2.0))
        if share > MUCH_AT_FLOOR:
            yield (
                f"sensor.{keys} {theta:g} with sigma_thres={sigma:g}, so {100 * share:.0f} % of "
                f"these thresholds are at the minimum, {floor:g}; lower sigma_thres"
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
        yield (
            f"sensor.refractory_period_s is {blind_s:g}, so a pixel is blind for {blind_s:g} s "
            "after each event"
        )
    for key in ("cutoff_hz", "follower_hz"):
        hz = sensor.get(key) or 0.0
        if 0.0 < hz < SLOW_HZ:
            yield (
                f"sensor.{key} is {hz:g}, so a pixel lags {0.5 / math.pi / hz:.2g} s behind the "
                "light"
            )
