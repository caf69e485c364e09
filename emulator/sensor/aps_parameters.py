"""ApsParameters: every number of the intensity frames that a DAVIS gives beside its events."""

from __future__ import annotations

from dataclasses import dataclass

from evs.emulator.sensor.ranges import check_ranges, check_switch, check_whole
from evs.msgs import EvsError, unknown

SHUTTERS = ("global", "rolling")

_RANGES = {
    "rate_hz": (1e-3, 1e5),
    "exposure_us": (1, 10_000_000),
    "row_us": (0.0, 1e5),
    "gain": (1e-6, 1e6),
    "adc_bits": (1, 16),
    "full_well_e": (0.0, 1e9),
    "read_noise_dn": (0.0, 65535.0),
}


@dataclass(frozen=True)
class ApsParameters:
    """[sensor.aps]: active pixels. Raises EvsError for values without sense."""

    enabled: bool = False
    """whether there are frames at all"""
    rate_hz: float = 25.0
    """frames per second; frame n begins at n / rate_hz of simulated time"""
    exposure_us: int = 10_000
    """how long a row collects light, us"""
    shutter: str = "global"
    """global: all rows at once | rolling: each row row_us after the one above it"""
    row_us: float = 0.0
    """time to read out a row, us"""
    gain: float = 1.0
    """at 1, light of 255 DN (white of the event pixels) all through the exposure fills the range"""
    bits: int = 8
    """of a pixel of the frame: 8 or 16; the ADC's bits are the upper ones of them"""
    adc_bits: int = 10
    """resolution of the converter"""
    full_well_e: float = 0.0
    """electrons that white is: shot noise is their square root; 0: no shot noise"""
    read_noise_dn: float = 0.0
    """standard deviation of the read noise, steps of the ADC; 0: none"""

    def __post_init__(self) -> None:
        for key in ("exposure_us", "bits", "adc_bits"):
            check_whole("sensor.aps", self, key)
        check_switch("sensor.aps", self, "enabled")
        check_ranges("sensor.aps", self, _RANGES)
        if self.bits not in (8, 16):
            raise EvsError(f"sensor.aps.bits is {self.bits}; give 8 or 16")
        if self.shutter not in SHUTTERS:
            raise unknown("shutter (sensor.aps.shutter)", str(self.shutter), SHUTTERS)

    def row_offset_us(self, row: int) -> int:
        """How long after the frame's begin a row's exposure begins, us."""
        return round(row * self.row_us) if self.shutter == "rolling" else 0

    def frame_us(self, rows: int) -> int:
        """From the beginning of a frame until its last row has been read out, us."""
        return self.exposure_us + round(rows * self.row_us)

    def check_time(self, rows: int) -> None:
        """EvsError where frames of so many rows come faster than they can be taken."""
        needed_us = float(self.frame_us(rows))
        if self.shutter == "rolling":
            # a row may collect light again once it has been read out
            needed_us = max(self.exposure_us + self.row_us, rows * self.row_us)
        if needed_us * self.rate_hz > 1e6 * (1 + 1e-9):
            raise EvsError(
                f"sensor.aps.rate_hz is {self.rate_hz:g}, but a frame takes {needed_us:g} us: "
                f"give {1e6 / needed_us:.6g} at most, or a shorter exposure_us"
            )
