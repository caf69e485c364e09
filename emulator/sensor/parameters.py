"""Resolved parameters of a sensor, checked. evs.emulator.config.sensor declares them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Never

from evs.emulator.base.scene import MAX_PIXELS
from evs.emulator.config.declaration import declaration, specialised
from evs.emulator.config.sensor import WHITE_DN, ApsKeys, ImuKeys, PixelKeys
from evs.emulator.sensor.ranges import check_declared
from evs.emulator.sensor.readout.parameters import ReadoutParameters
from evs.msgs import EvsError

MIN_DARK_DN = 1e-12
MIN_RATE_HZ = 1e-9
"""Once in 30 years; lower ones would be denormal float32 in short ticks."""


@dataclass(frozen=True)
@specialised
class ApsParameters(ApsKeys[Never]):
    """[sensor.aps]: active pixels. Raises EvsError for values without sense."""

    def __post_init__(self) -> None:
        check_declared("sensor.aps", self)
        if self.bits not in (8, 16):
            raise EvsError(f"sensor.aps.bits is {self.bits}; give 8 or 16")

    def row_offset_us(self, row: int) -> int:
        """How long after the frame's begin a row's exposure begins, us."""
        return round(row * self.row_us) if self.shutter == "rolling" else 0

    def frame_us(self, rows: int) -> int:
        """From the beginning of a frame until its last row has been read out, us."""
        return self.exposure_us + round(rows * self.row_us)

    def check_time(self, rows: int) -> None:
        """Check that frames of so many rows do not come faster than they can be taken.

        Raises:
            EvsError: They do; the message has the highest rate.
        """
        needed_us = float(self.frame_us(rows))
        if self.shutter == "rolling":
            # a row may collect light again once it has been read out
            needed_us = max(self.exposure_us + self.row_us, rows * self.row_us)
        if needed_us * self.rate_hz > 1e6 * (1 + 1e-9):
            raise EvsError(
                f"sensor.aps.rate_hz is {self.rate_hz:g}, but a frame takes {needed_us:g} us: "
                f"give {1e6 / needed_us:.6g} at most, or a shorter exposure_us"
            )


@dataclass(frozen=True)
@specialised
class ImuParameters(ImuKeys[Never]):
    """[sensor.imu]: names and meanings as Kalibr's, SI. EvsError for values without sense."""

    def __post_init__(self) -> None:
        check_declared("sensor.imu", self)


@dataclass(frozen=True)
class _Named:
    name: str
    """name of the preset, or of the file without its ending"""


@dataclass(frozen=True)
@specialised
class SensorParameters(PixelKeys[Never], _Named):
    """An event sensor. Names and meanings as v2e's. Raises EvsError for values without sense."""

    aps: ApsParameters = field(default_factory=ApsParameters)
    imu: ImuParameters = field(default_factory=ImuParameters)
    readout: ReadoutParameters = field(default_factory=ReadoutParameters)

    def __post_init__(self) -> None:
        knee = self.linlog_dn
        if isinstance(knee, int | float) and not isinstance(knee, bool) and knee <= 1.0:
            raise EvsError(
                f"sensor.linlog_dn is {knee:g}; linlog is monotone only above 1 (smooth at e)"
            )
        check_declared("sensor", self)
        if self.width * self.height > MAX_PIXELS:
            raise EvsError(
                f"sensor of {self.width} x {self.height} px; make it at most {MAX_PIXELS} px"
            )
        for each in fields(self):
            declared, value = declaration(each), getattr(self, each.name)
            if declared is not None and declared.unit == "Hz" and 0 < value < MIN_RATE_HZ:
                raise EvsError(f"sensor.{each.name} is {value:g}; give 0 or over {MIN_RATE_HZ:g}")
        if 0 < self.dark_dn < MIN_DARK_DN:  # its logarithm would be a denormal float32
            least = MIN_DARK_DN * self.lux_per_dn
            raise EvsError(f"sensor.dark_lux is {self.dark_lux:g}; give 0 or over {least:g}")
        if self.hot_pixel_fraction + self.dead_pixel_fraction > 1.0:
            raise EvsError(
                "sensor.hot_pixel_fraction and sensor.dead_pixel_fraction are over 1 together; "
                "lower one"
            )

    @property
    def lux_per_dn(self) -> float:
        """Illuminance of a DN, lux."""
        return self.white_lux / WHITE_DN

    @property
    def dark_dn(self) -> float:
        """Dark current, DN."""
        return self.dark_lux / self.lux_per_dn

    @property
    def has_hot_pixels(self) -> bool:
        """Whether any pixel may be hot."""
        return self.hot_pixel_fraction > 0.0 and self.hot_pixel_rate_hz > 0.0

    @property
    def refractory_us(self) -> int:
        """The refractory period in whole us."""
        return round(self.refractory_period_s * 1e6)
