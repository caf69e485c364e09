"""Luminance to log light.

Every float32 step is that of core/base/reproducible_math.h and core/sensor/log_map.h.
"""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.running_mean import BLACK

_LN_FIT = (
    "0x1.1457aep-4 -0x1.de3c22p-4 0x1.e6f06ep-4 -0x1.fc2206p-4 0x1.233768p-3 "
    "-0x1.555c4ep-3 0x1.99a4b6p-3 -0x1.000006p-2 0x1.555548p-2"
)
_P = [np.float32(float.fromhex(number)) for number in _LN_FIT.split()]
LN2_HIGH = np.float32(float.fromhex("0x1.62e4p-1"))
LN2_LOW = np.float32(float.fromhex("0x1.7f7d1cp-20"))


def natural_log(x: F32) -> F32:
    """ln of normal, positive, finite float32 of any shape."""
    bits = x.view(np.int32)
    exponent = (bits - np.int32(0x3F3504F3)) >> 23
    f = (bits - (exponent << 23)).view(np.float32) - np.float32(1)
    p = np.full_like(f, _P[0])
    for coefficient in _P[1:]:
        p = p * f + coefficient
    square = f * f
    tail = square * f * p - np.float32(0.5) * square
    e = exponent.astype(np.float32)
    high = e * LN2_HIGH
    total = high + f
    rest = f - (total - high)
    out: F32 = total + (rest + (e * LN2_LOW + tail))
    return out


def to_dn(luminance: F32, sensor: SensorParameters) -> F32:
    """DN of a luminance, whatever it is; light of less than 2^-64 is black."""
    with np.errstate(over="ignore", invalid="ignore"):
        light = np.where(np.abs(luminance) < BLACK, np.float32(0), luminance)
        dn: F32 = light * np.float32(sensor.exposure_dn) + np.float32(sensor.dark_dn)
    return dn


def is_light(luminance: F32, sensor: SensorParameters) -> np.ndarray:
    """False where it is negative, NaN, Inf, or so strong that its DN is no float."""
    return (luminance > -BLACK) & (to_dn(luminance, sensor) <= np.finfo(np.float32).max)


def log_light(luminance: F32, sensor: SensorParameters) -> F32:
    """L_log (h, w); NaN where the luminance is no light."""
    usable = is_light(luminance, sensor)
    dn = np.where(usable, to_dn(luminance, sensor), np.float32(1)).astype(np.float32)
    if sensor.log == "log_eps":
        mapped = natural_log(dn / np.float32(255) + np.float32(sensor.log_eps))
    elif sensor.log == "ln":
        mapped = natural_log(dn)
    else:
        knee = np.array([sensor.linlog_dn], np.float32)
        ln_knee = natural_log(knee)
        above = natural_log(np.maximum(dn, knee).astype(np.float32))
        mapped = np.where(dn >= knee, above, np.minimum(ln_knee / knee * dn, ln_knee))
    return np.where(usable, mapped, np.float32(np.nan))
