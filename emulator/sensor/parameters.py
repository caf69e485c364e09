"""SensorParameters: every number of an event pixel array, checked."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from evs.emulator.base.scene import MAX_PIXELS
from evs.emulator.sensor.aps_parameters import ApsParameters
from evs.emulator.sensor.imu_parameters import ImuParameters
from evs.emulator.sensor.ranges import check_ranges
from evs.emulator.sensor.readout.parameters import ReadoutParameters
from evs.msgs import EvsError, unknown

MAX_SIDE_PX = 8192
LOG_MAPS = ("linlog", "log_eps")
FILTERS = ("exact", "euler")
SHOT_NOISE_LAWS = ("linear", "inverse")
MIN_DARK_DN = 1e-12
MIN_RATE_HZ = 1e-9
"""Once in 30 years; lower ones would be denormal float32 in short ticks."""
WHITE_DN = 255.0
"""DN of scene white; nothing is clipped there."""

# lowest and highest value that makes sense, both allowed; the width of the ranges keeps every
# intermediate of the log map a normal float32
_RANGES = {
    "pos_thres": (0.001, 20.0),
    "neg_thres": (0.001, 20.0),
    "sigma_thres": (0.0, 10.0),
    "linlog_dn": (math.nextafter(1.0, 2.0), 1e6),
    "log_eps": (1e-9, 1e3),
    "exposure_dn": (1e-6, 1e9),
    "white_lux": (1e-6, 1e9),
    "dark_lux": (0.0, 1e6),
    "cutoff_hz": (0.0, 1e7),
    "dim_lux": (0.0, 1e6),
    "bright_lux": (1e-3, 1e9),
    "follower_hz": (0.0, 1e7),
    "highpass_hz": (0.0, 1e6),
    "leak_rate_hz": (0.0, 1e4),
    "parasitic_leak_hz": (0.0, 1e4),
    "shot_noise_rate_hz": (0.0, 1e5),
    "shot_noise_bright": (0.0, 1.0),
    "noise_rate_cov_decades": (0.0, 1.0),
    "refractory_period_s": (0.0, 100.0),
    "hot_pixel_fraction": (0.0, 1.0),
    "hot_pixel_rate_hz": (0.0, 1e4),
    "dead_pixel_fraction": (0.0, 1.0),
    "latency_us": (0.0, 1e6),
    "latency_sigma_us": (0.0, 1e6),
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
    exposure_dn: float = WHITE_DN
    """DN per unit of luminance: DN = exposure_dn * luminance + dark_dn"""
    white_lux: float = 1000.0
    """illuminance of the sensor at 255 DN, lux: what bandwidth and noise go by"""
    dark_lux: float = 0.0
    """dark current, as the light that would give it: added to every pixel before the log, lux"""
    cutoff_hz: float = 0.0
    """bandwidth of the photoreceptor at bright_lux, Hz; 0: no limit. At an illuminance E it is
    cutoff_hz (E + dim_lux) / (bright_lux + dim_lux): in proportion to the photocurrent"""
    dim_lux: float = 20.0 / WHITE_DN * 1000.0
    """illuminance below which bandwidth stops falling and shot noise stops growing, lux; the
    default is v2e's 20 of 255 DN"""
    bright_lux: float = 1000.0
    """illuminance that cutoff_hz, parasitic_leak_hz and shot_noise_bright are for, lux"""
    filter: str = "exact"
    """how the low passes are stepped. exact: for light that is a line inside the tick, any tick.
    euler: v2e's, y += min(1, 2 pi f dt) (x - y)"""
    follower_hz: float = 0.0
    """bandwidth of the source follower after the photoreceptor, a second pole, Hz; 0: no limit"""
    highpass_hz: float = 0.0
    """the reference follows the signal at this rate, so that slow changes give no events, Hz"""
    leak_rate_hz: float = 0.0
    """ON events of a pixel in still light because its reference sinks, mean over pixels, Hz"""
    parasitic_leak_hz: float = 0.0
    """how many more there are at bright_lux, in proportion to the illuminance, Hz"""
    shot_noise_rate_hz: float = 0.0
    """noise events of both polarities of a pixel in the dark, mean over pixels, Hz"""
    shot_noise_bright: float = 0.25
    """share of them that is left at bright_lux (linear) or in the brightest light (inverse)"""
    shot_noise_law: str = "linear"
    """linear: v2e's, the rate falls in proportion to the bandwidth until bright_lux.
    inverse: bright + (1 - bright) dim_lux / (dim_lux + E), bright being shot_noise_bright"""
    noise_rate_cov_decades: float = 0.0
    """spread over pixels of the rates of leak and of shot noise, standard deviation of log10"""
    refractory_period_s: float = 0.0
    """how long a pixel is blind after each event, s (whole us); then its reference is the light"""
    hot_pixel_fraction: float = 0.0
    """share of pixels whose leak has a rate of its own"""
    hot_pixel_rate_hz: float = 100.0
    """mean rate of that leak, Hz"""
    dead_pixel_fraction: float = 0.0
    """share of pixels that never fire"""
    latency_us: float = 0.0
    """mean time from the crossing of a threshold to the pixel's request to be read, us"""
    latency_sigma_us: float = 0.0
    """its standard deviation from event to event, us; no latency is below 0"""

    aps: ApsParameters = field(default_factory=ApsParameters)
    imu: ImuParameters = field(default_factory=ImuParameters)
    readout: ReadoutParameters = field(default_factory=ReadoutParameters)

    def __post_init__(self) -> None:
        self._check_size()
        self._check_numbers()
        self._check_words()

    def _check_size(self) -> None:
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

    def _check_numbers(self) -> None:
        knee = self.linlog_dn
        if isinstance(knee, int | float) and not isinstance(knee, bool) and knee <= 1.0:
            raise EvsError(
                f"sensor.linlog_dn is {knee:g}; linlog is monotone only above 1 (smooth at e)"
            )
        check_ranges("sensor", self, _RANGES)
        for key in _RANGES:
            if key.endswith("_hz") and 0 < getattr(self, key) < MIN_RATE_HZ:
                given = getattr(self, key)
                raise EvsError(f"sensor.{key} is {given:g}; give 0 or over {MIN_RATE_HZ:g}")
        if 0 < self.dark_dn < MIN_DARK_DN:  # its logarithm would be a denormal float32
            least = MIN_DARK_DN * self.lux_per_dn
            raise EvsError(f"sensor.dark_lux is {self.dark_lux:g}; give 0 or over {least:g}")
        if self.hot_pixel_fraction + self.dead_pixel_fraction > 1.0:
            raise EvsError(
                "sensor.hot_pixel_fraction and sensor.dead_pixel_fraction are over 1 together; "
                "lower one"
            )

    def _check_words(self) -> None:
        for key, what, known in (
            ("log", "log map", LOG_MAPS),
            ("filter", "filter", FILTERS),
            ("shot_noise_law", "law of shot noise", SHOT_NOISE_LAWS),
        ):
            if getattr(self, key) not in known:
                raise unknown(f"{what} (sensor.{key})", str(getattr(self, key)), known)

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
