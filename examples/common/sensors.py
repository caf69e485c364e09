"""The cameras of the loops: one that gives events, or the same one giving frames."""

from __future__ import annotations

from evs.emulator.config import ApsConfig, SensorConfig

LONGEST_US = 5000
"""Exposures of slow cameras: in bright light no longer is needed."""


def sensor_of(fps: int) -> SensorConfig:
    """A DVS128; with fps over 0, one that takes frames too, without noise.

    The exposure is half of the period, 5 ms at most, and a frame arrives a period after its begin,
    as from a camera on USB.
    """
    if not fps:
        return SensorConfig("dvs128")
    period_us = 1_000_000 // fps
    exposure_us = min(period_us // 2, LONGEST_US)
    row_us = (period_us - exposure_us) / 128
    return SensorConfig(
        "dvs128",
        aps=ApsConfig(
            enabled=True, rate_hz=float(fps), exposure_us=exposure_us, row_us=row_us, adc_bits=8
        ),
    )
