"""Resolved parameters of a sensor, checked. evs.emulator.config.sensor declares them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, Never, get_args

from evs.emulator.base.features import Switches
from evs.emulator.base.scene import MAX_PIXELS
from evs.emulator.config import ModelConfig
from evs.emulator.config.declaration import Declaration, declaration, specialised
from evs.emulator.config.sensor import WHITE_DN, ApsKeys, ImuKeys, PixelKeys, ReadoutKeys
from evs.msgs import EvsError, unknown


@dataclass(frozen=True)
@specialised
class ReadoutParameters(ReadoutKeys[Never]):
    """[readout] of a sensor; nothing of it by default. Raises EvsError for values without sense.

    The way of an event: region of interest and mask, the latency of its pixel (sensor.latency_us),
    `order`, event rate control, link. What is dropped on the way is counted by cause.
    """

    def __post_init__(self) -> None:
        check_declared("sensor.readout", self)
        for key, each, form in (("roi", 4, "x y width height"), ("mask", 2, "x y")):
            values = getattr(self, key)
            if not isinstance(values, tuple) or not all(map(is_whole, values)):
                raise EvsError(f"sensor.readout.{key} is {values!r}; give whole numbers")
            if len(values) % each:
                raise EvsError(
                    f"sensor.readout.{key} has {len(values)} numbers; give {form}, and again {form}"
                )
        if not isinstance(self.mask_file, str):
            raise EvsError(f"sensor.readout.mask_file is {self.mask_file!r}; give a file")
        if 0 < self.bandwidth_mevs < 1e-6:
            raise EvsError(
                f"sensor.readout.bandwidth_mevs is {self.bandwidth_mevs:g}; "
                "give 0 (unlimited) or 1e-06 (an event a second) and more"
            )
        if self.erc_rate_mevs > 0 and self.erc_target == 0:
            raise EvsError(
                f"sensor.readout.erc_rate_mevs is {self.erc_rate_mevs:g}: not one event each "
                f"{self.erc_period_us} us; raise it or erc_period_us"
            )

    @property
    def erc_target(self) -> int:
        """Events that event rate control lets through in a period; 0: it is off."""
        # Mev/s times us; what is whole in decimal stays so
        return math.floor(round(self.erc_rate_mevs * self.erc_period_us, 6))

    @property
    def link_rate(self) -> int:
        """Events that leave by the link in a second at most; 0: unlimited."""
        return round(self.bandwidth_mevs * 1e6)

    @property
    def is_ideal(self) -> bool:
        """Whether every event passes at its own time."""
        limits = self.erc_rate_mevs > 0 or self.bandwidth_mevs > 0
        return self.order == "ideal" and not (limits or self.roi or self.mask or self.mask_file)


MIN_DARK_DN = 1e-12
MIN_RATE_HZ = 1e-9
"""Once in 30 years; lower ones would be denormal float32 in short ticks."""

ELECTRON_C = 1.602176634e-19


REFERENCE_C = 25.0
"""the temperature at which dark current and leak are specified"""

ACTIVATION_EV = 0.63
"""Activation energy of dark current and junction leak. Both follow Arrhenius' law in DVS pixels
(Nozaki and Delbruck, IEEE TED 64(8), 2017). Generation in a depletion layer has half the band gap,
0.56 eV, diffusion all of it (Widenhorn et al., Proc. SPIE 4669, 2002); 0.63 eV was measured on
the CCDs of MERIS between 6 and 40 degrees C."""

HOT_LEAK_HZ = 1.0
"""a pixel is hot, and its leak events have the cause `hot`, if its own part of the tail of leak,
which hot_leak_median_hz begins, is over this rate at the temperature of the chip"""

MOST_HOT_LEAK_HZ = 1000.0
"""that part is at most this"""

BOLTZMANN_EV_K = 8.617333262e-5
ZERO_C_K = 273.15


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

    def read_us(self, row: float) -> int:
        """The time to read so many rows, rounded to whole us; negative: before."""
        return round(row * self.row_us)

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
            least = MIN_DARK_DN * self.lux_per_dn / self.thermal_factor
            raise EvsError(f"sensor.dark_lux is {self.dark_lux:g}; give 0 or over {least:g}")
        if self.log == "ln" and self.dark_lux == 0:
            raise EvsError(
                "sensor.log is ln, but sensor.dark_lux is 0 and black has no logarithm; "
                "give sensor.dark_lux, or sensor.log=linlog"
            )
        if self.photocurrent_pa > 0.0:
            if self.dark_lux <= 0.0:
                raise EvsError(
                    "sensor.photocurrent_pa needs a dark current, or its noise has no bound in the "
                    "dark; set sensor.dark_lux over 0, or photocurrent_pa=0"
                )
            if self.cutoff_hz == self.follower_hz == 0.0:
                raise EvsError(
                    "sensor.photocurrent_pa needs a bandwidth that limits its noise; set "
                    "sensor.cutoff_hz or sensor.follower_hz, or photocurrent_pa=0"
                )
        scan = self.readout
        if scan.order == "scan" and self.width * scan.scan_column_ns > scan.scan_us * 1000:
            raise EvsError(
                f"sensor.readout.scan_column_ns is {scan.scan_column_ns}: {self.width} columns "
                f"take longer than sensor.readout.scan_us, {scan.scan_us} us; give at most "
                f"{scan.scan_us * 1000 // self.width}"
            )

    @property
    def lux_per_dn(self) -> float:
        """Illuminance of a DN, lux."""
        return self.white_lux / WHITE_DN

    @property
    def thermal_factor(self) -> float:
        """By how much dark current and junction leak exceed theirs at 25 degrees C."""
        if self.temperature_c == REFERENCE_C:
            return 1.0
        per_kelvin = 1.0 / (REFERENCE_C + ZERO_C_K) - 1.0 / (self.temperature_c + ZERO_C_K)
        # nine digits: the same on every machine, whose exp may differ in the last bit
        return float(f"{math.exp(ACTIVATION_EV / BOLTZMANN_EV_K * per_kelvin):.9g}")

    @property
    def dark_current_lux(self) -> float:
        """Dark current at the temperature of the chip, as an illuminance, lux."""
        return self.dark_lux * self.thermal_factor

    @property
    def dark_dn(self) -> float:
        """Dark current at the temperature of the chip, DN."""
        return self.dark_current_lux / self.lux_per_dn

    @property
    def photon_scale_us(self) -> float:
        """Variance of the photon noise, log units squared, times DN over its bandwidth, us."""
        if self.photocurrent_pa == 0.0:
            return 0.0
        electrons_per_us = self.photocurrent_pa * 1e-12 / ELECTRON_C * 1e-6
        per_dn = electrons_per_us * self.lux_per_dn / self.bright_lux
        # one-sided density of the log: 2 factor / electrons; a pole w passes w / 4 of it
        return 2.0 * self.photon_noise_factor / per_dn / 4.0

    @property
    def has_hot_pixels(self) -> bool:
        """Whether any pixel may be hot."""
        return self.hot_leak_median_hz > 0.0

    @property
    def refractory_us(self) -> int:
        """The refractory period in whole us."""
        return round(self.refractory_period_s * 1e6)


@dataclass(frozen=True)
class ModelRequest:
    """The arguments of camera.pixel_pipeline.make_event_model, for the function in a row."""

    sensor: SensorParameters
    model: ModelConfig
    threads: int
    """0: one per core"""
    spp: int
    """samples a pixel of light with noise; 0: it has none"""
    switches: Switches
    isa: str


def check_declared(table: str, parameters: Any) -> None:
    """Check every declared value of a dataclass: its type, its range, the words that it may be.

    Args:
        table: `sensor.aps` for [sensor.aps], for messages.
        parameters: An instance of a class whose fields are made by `declaration.parameter`.

    Raises:
        EvsError: A value is not of its type, or out of its range; the message has its key.
    """
    for each in fields(parameters):
        if (declared := declaration(each)) is not None:
            key, value = f"{table}.{each.name}", getattr(parameters, each.name)
            _check(key, value, each.type, declared)


def _check(key: str, value: Any, kind: Any, declared: Declaration) -> None:
    items = get_args(kind)
    if kind is bool and not isinstance(value, bool):
        raise EvsError(f"{key} is {value!r}; give true or false")
    if declared.choices and value not in declared.choices:
        raise unknown(f"{declared.noun} ({key})", str(value), declared.choices)
    if kind is int and not is_whole(value):
        raise EvsError(f"{key} is {value!r}; give a whole number")
    if len(items) == 3 and (not isinstance(value, tuple) or len(value) != 3):
        raise EvsError(f"{key} is {value!r}; give three numbers: x, y, z")
    if declared.within is None:
        return
    lowest, highest = declared.within
    shown = "d" if kind is int else "g"
    for item in value if isinstance(value, tuple) else (value,):
        if not isinstance(item, int | float) or isinstance(item, bool):
            raise EvsError(f"{key} is {value!r}; give a number")
        if not lowest <= item <= highest:  # also where it is NaN
            raise EvsError(f"{key} is {item:{shown}}; give {lowest:{shown}} ... {highest:{shown}}")


def is_whole(value: Any) -> bool:
    """Whether it is an int, and no bool."""
    return isinstance(value, int) and not isinstance(value, bool)
