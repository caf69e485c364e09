"""Luminance to log light, outside the pixel: for networks, pictures and tests."""

from __future__ import annotations

import numpy as np

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.sensor.parameters import SensorParameters


def log_light(luminance: F32, sensor: SensorParameters) -> F32:
    """Map luminance to log units, with the same bits as inside the event models.

    Args:
        luminance: Of any shape, linear, as of Renderer.render.
        sensor: The sensor, resolved.

    Returns:
        L_log, float32; NaN where the luminance is negative, NaN or Inf.
    """
    flat = np.ascontiguousarray(luminance, np.float32).reshape(-1)
    mapped: F32 = _core.log_map(
        flat,
        log=sensor.log,
        exposure_dn=sensor.exposure_dn,
        dark_dn=sensor.dark_dn,
        linlog_dn=sensor.linlog_dn,
        log_eps=sensor.log_eps,
    )
    return mapped.reshape(np.shape(luminance))
