"""SensorParameters: every number of an event pixel array, checked."""

from __future__ import annotations

import math
from dataclasses import dataclass

from evs.emulator.scene import MAX_PIXELS
from evs.msgs import EvsError, unknown

MAX_SIDE_PX = 8192
LOG_MAPS = ("linlog", "log_eps")
MIN_DARK_DN = 1e-12

# lowest and highest value that makes sense, both allowed; the width of the ranges keeps every
# intermediate of the log map a normal float32
_RANGES = {
    "pos_thres": (0.01, 20.0),
    "neg_thres": (0.01, 20.0),
    "sigma_thres": (0.0, 10.0),
    "linlog_dn": (math.nextafter(1.0, 2.0), 1e6),
    "log_eps": (1e-9, 1e3),
    "dark_dn": (0.0, 1e6),
    "exposure_dn": (1e-6, 1e9),
}


@dataclass(frozen=True)
class SensorParameters:
    """An event sensor. Names and meanings as v2e's. Raises EvsError for values without sense."""

    name: str
    """name of the preset, or of the file without its ending"""
    width: int
    """px"""
    height: int
    """px"""
    pos_thres: float
    """mean ON threshold, log units"""
    neg_thres: float
    """mean OFF threshold, log units"""
    sigma_thres: float = 0.0
    """standard deviation of both over pixels (fixed pattern), log units"""
    log: str = "linlog"
    """linlog: ln DN from linlog_dn on, (ln linlog_dn / linlog_dn) DN below.
    log_eps: ln(DN / 255 + log_eps)."""
    linlog_dn: float = math.e
    """DN at which linlog turns from linear to logarithmic; over 1; smooth at e only"""
    log_eps: float = 1e-3
    dark_dn: float = 0.0
    """DN of dark current, added to every pixel before the log"""
    exposure_dn: float = 255.0
    """DN per unit of luminance: DN = exposure_dn * luminance + dark_dn"""

    def __post_init__(self) -> None:
        for side in ("width", "height"):
            pixels = getattr(self, side)
            if not isinstance(pixels, int) or isinstance(pixels, bool):
                raise EvsError(f"sensor.{side} is {pixels!r}; give a whole number of pixels")
            if not 1 <= pixels <= MAX_SIDE_PX:
                raise EvsError(f"sensor.{side} is {pixels}; give 1 ... {MAX_SIDE_PX} px")
        if self.width * self.height > MAX_PIXELS:
            raise EvsError(
                f"sensor of {self.width} x {self.height} px; make it at most {MAX_PIXELS} px"
            )
        for key, (lowest, highest) in _RANGES.items():
            value = getattr(self, key)
            if not isinstance(value, int | float) or isinstance(value, bool):
                raise EvsError(f"sensor.{key} is {value!r}; give a number")
            if key == "linlog_dn" and value <= 1.0:
                raise EvsError(
                    f"sensor.linlog_dn is {value:g}; linlog is monotone only above 1 (smooth at e)"
                )
            if not lowest <= value <= highest:  # also where it is NaN
                raise EvsError(f"sensor.{key} is {value:g}; give {lowest:g} ... {highest:g}")
        if 0 < self.dark_dn < MIN_DARK_DN:  # its logarithm would be a denormal float32
            raise EvsError(f"sensor.dark_dn is {self.dark_dn:g}; give 0 or over {MIN_DARK_DN:g}")
        if self.log not in LOG_MAPS:
            raise unknown("log map (sensor.log)", str(self.log), LOG_MAPS)
