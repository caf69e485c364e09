"""[sensor] and its tables: the declaration of every sensor parameter, and the biases of real chips.

To add a parameter, add one entry here and use it in the model (emulator/sensor). Configuration
keys, ranges, documentation, `evs sensors` and the plan follow from the entry.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Generic

from evs.emulator.config.declaration import (
    REQUIRED,
    Term,
    Unset,
    any_path,
    parameter,
    path_or_name,
    specialised,
)
from evs.emulator.config.keywords import named_keywords


@named_keywords
@dataclass(frozen=True)
class BiasConfig:
    """[sensor.biases]: the chip's own biases, with its drivers' names. None: the preset's value.

    A sensor accepts only the biases of its own chip. Each bias scales a parameter of the preset by
    the chip's law (emulator/sensor/bias_laws.py).
    """

    bias_diff_on: int | None = None
    """IMX636, GenX320: ON threshold; higher is less sensitive"""
    bias_diff_off: int | None = None
    """IMX636, GenX320: OFF threshold; higher is less sensitive"""
    bias_fo: int | None = None
    """IMX636, GenX320: low-pass filter; higher is faster and noisier"""
    bias_hpf: int | None = None
    """IMX636, GenX320: high-pass filter; higher follows the light faster; 0: off"""
    bias_refr: int | None = None
    """IMX636, GenX320: refractory period; higher is shorter"""
    PrBp_coarse: int | None = None
    """DAVIS: photoreceptor, decade of the current; higher is faster"""
    PrBp_fine: int | None = None
    """DAVIS: photoreceptor, fine: 1 ... 255, in units of 1/255 of the coarse current"""
    PrSFBp_coarse: int | None = None
    """DAVIS: source follower behind the photoreceptor; higher is faster"""
    PrSFBp_fine: int | None = None
    """DAVIS: source follower, fine"""
    DiffBn_coarse: int | None = None
    """DAVIS: change amplifier, the reference of the ON and OFF thresholds"""
    DiffBn_fine: int | None = None
    """DAVIS: change amplifier, fine"""
    ONBn_coarse: int | None = None
    """DAVIS: ON comparator; the ratio of its current to DiffBn's sets the ON threshold"""
    ONBn_fine: int | None = None
    """DAVIS: ON comparator, fine"""
    OFFBn_coarse: int | None = None
    """DAVIS: OFF comparator; the ratio of DiffBn's current to its own sets the OFF threshold"""
    OFFBn_fine: int | None = None
    """DAVIS: OFF comparator, fine"""
    RefrBp_coarse: int | None = None
    """DAVIS: refractory period; higher is shorter"""
    RefrBp_fine: int | None = None
    """DAVIS: refractory period, fine"""
    bias_sensitivity: int | None = None
    """DVXplorer: both contrast thresholds: 0 (very low) ... 2 (default) ... 4 (very high)"""
    contrastThresholdOn: int | None = None  # noqa: N815
    """DVXplorer: ON threshold, 0 ... 17; higher is less sensitive"""
    contrastThresholdOff: int | None = None  # noqa: N815
    """DVXplorer: OFF threshold, 0 ... 17; higher is less sensitive"""
    Pr: int | None = None
    """DVS128: photoreceptor, in units of 2^-24 of the master current; higher is faster"""
    foll: int | None = None
    """DVS128: source follower; higher is faster"""
    diff: int | None = None
    """DVS128: change amplifier, the reference of both thresholds"""
    diffOn: int | None = None  # noqa: N815
    """DVS128: ON comparator; higher is less sensitive"""
    diffOff: int | None = None  # noqa: N815
    """DVS128: OFF comparator; lower is less sensitive"""
    refr: int | None = None
    """DVS128: refractory period; higher is shorter"""


MAX_SIDE_PX = 8192
WHITE_DN = 255.0
"""DN of scene white; values above it are not clipped."""

BRIGHTEST_DN = 20.0 * WHITE_DN
"""of a whole picture on average: more is probably another unit"""

ROUNDS = "it would round the light one more time"

DEFECTS = Term("defects", "hot and dead pixels")

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class PixelKeys(Generic[Unset]):
    """The event pixel. Names and meanings are those of v2e.

    The ranges are so narrow that every intermediate of the log map is a normal float32.
    """

    width: int | Unset = parameter(
        REQUIRED,
        "columns of pixels",
        unit="px",
        within=(1, MAX_SIDE_PX),
    )
    height: int | Unset = parameter(
        REQUIRED,
        "rows of pixels",
        unit="px",
        within=(1, MAX_SIDE_PX),
    )
    pos_thres: float | Unset = parameter(
        REQUIRED,
        "mean ON threshold",
        unit="log units",
        within=(0.001, 20.0),
    )
    neg_thres: float | Unset = parameter(
        REQUIRED,
        "mean OFF threshold",
        unit="log units",
        within=(0.001, 20.0),
    )
    sigma_thres: float | Unset = parameter(
        0.0,
        "threshold mismatch: standard deviation of both thresholds over pixels (fixed pattern)",
        unit="log units",
        within=(0.0, 10.0),
        term=Term("threshold_spread", "a threshold of its own for each pixel"),
    )
    log: str | Unset = parameter(
        "linlog",
        "log map. linlog: ln DN at and above linlog_dn, (ln linlog_dn / linlog_dn) DN below | "
        "log_eps: ln(DN / 255 + log_eps) | ln: ln DN of photocurrent and dark current, as in "
        "silicon; it needs dark_lux above 0",
        choices=("linlog", "log_eps", "ln"),
        noun="log map",
    )
    linlog_dn: float | Unset = parameter(
        math.e,
        "DN at which linlog changes from linear to logarithmic; must exceed 1; smooth only at e",
        unit="DN",
        within=(math.nextafter(1.0, 2.0), 1e6),
    )
    log_eps: float | Unset = parameter(
        1e-3,
        "offset that log_eps adds to the light, where 1 is white",
        within=(1e-9, 1e3),
    )
    exposure_dn: float | Unset = parameter(
        WHITE_DN,
        "DN per unit of scene luminance: DN = exposure_dn * luminance + dark DN; 255 DN is white; "
        "values above it are not clipped",
        unit="DN",
        within=(1e-6, 1e9),
    )
    white_lux: float | Unset = parameter(
        1000.0,
        "illuminance of the sensor at 255 DN; bandwidth and noise depend on it",
        unit="lux",
        within=(1e-6, 1e9),
    )
    dark_lux: float | Unset = parameter(
        0.0,
        "dark current, as an equivalent illuminance that is added to every pixel before the log; "
        "it limits contrast in the dark",
        unit="lux",
        within=(0.0, 1e6),
    )
    temperature_c: float | Unset = parameter(
        25.0,
        "temperature of the chip: dark current and leak double about every 8 degrees; dark_lux "
        "and leak_rate_hz apply at 25",
        unit="degrees C",
        within=(-40.0, 125.0),
    )
    cutoff_hz: float | Unset = parameter(
        0.0,
        "photoreceptor bandwidth at bright_lux; 0: no limit. It is proportional to the "
        "photocurrent: cutoff_hz (E + dim_lux) / (bright_lux + dim_lux) at an illuminance E",
        unit="Hz",
        within=(0.0, 1e8),
        term=Term("low_pass", "bandwidth of the photoreceptor", ROUNDS),
    )
    dim_lux: float | Unset = parameter(
        20.0 / WHITE_DN * 1000.0,
        "added to the light that sets the bandwidth and the rate of shot noise, so that neither "
        "vanishes in the dark; the default is v2e's 20 of 255 DN. 0 where dark_lux limits both",
        unit="lux",
        within=(0.0, 1e6),
    )
    bright_lux: float | Unset = parameter(
        1000.0,
        "illuminance at which cutoff_hz, parasitic_leak_hz and shot_noise_bright are specified",
        unit="lux",
        within=(1e-3, 1e9),
    )
    filter: str | Unset = parameter(
        "exact",
        "integration of the low-pass filters. exact: for light that changes linearly within a "
        "tick of any length | large_signal: as exact, but the photoreceptor has its exponential "
        "feedback, y' = 2 pi f (1 - e^(y - x)): large steps are fast into light and slow into the "
        "dark | euler: v2e's y += min(1, 2 pi f dt) (x - y)",
        choices=("exact", "euler", "large_signal"),
        noun="filter",
    )
    follower_hz: float | Unset = parameter(
        0.0,
        "bandwidth of the source follower behind the photoreceptor, a second pole; 0: no limit",
        unit="Hz",
        within=(0.0, 1e7),
        term=Term("follower", "a second pole", ROUNDS),
    )
    highpass_hz: float | Unset = parameter(
        0.0,
        "high-pass corner: the reference follows the signal at this rate, so slower changes give "
        "no events; 0: off",
        unit="Hz",
        within=(0.0, 1e6),
        term=Term("high_pass", "references that follow the light"),
    )
    leak_rate_hz: float | Unset = parameter(
        0.0,
        "leak rate: ON events of a pixel in constant light, because its reference drifts down; "
        "mean over pixels, at 25 degrees C",
        unit="Hz",
        within=(0.0, 1e4),
        term=Term("leak", "references that sink"),
    )
    parasitic_leak_hz: float | Unset = parameter(
        0.0,
        "parasitic photocurrent: additional leak events at bright_lux, proportional to the "
        "illuminance",
        unit="Hz",
        within=(0.0, 1e4),
        term=Term("parasitic_leak", "references that sink faster in bright light"),
    )
    shot_noise_rate_hz: float | Unset = parameter(
        0.0,
        "shot noise: events of both polarities of a pixel in the dark, mean over pixels",
        unit="Hz",
        within=(0.0, 1e5),
        term=Term("shot_noise", "events out of nothing"),
    )
    shot_noise_bright: float | Unset = parameter(
        0.25,
        "fraction of the shot noise that remains at bright_lux (linear) or in the brightest light "
        "(inverse)",
        within=(0.0, 1.0),
    )
    shot_noise_law: str | Unset = parameter(
        "linear",
        "linear: as in v2e, the rate falls linearly with the bandwidth, up to bright_lux | "
        "inverse: bright + (1 - bright) dim_lux / (dim_lux + E), where bright is shot_noise_bright",
        choices=("linear", "inverse"),
        noun="law of shot noise",
    )
    photocurrent_pa: float | Unset = parameter(
        0.0,
        "photocurrent of a pixel at bright_lux; its shot noise, band-limited by the pixel's poles, "
        "is added to the log light before the comparators; 0: no such noise",
        unit="pA",
        within=(0.0, 1e6),
        term=Term(
            "photon_noise",
            "noise of the photocurrent in front of the comparators",
            "without a photocurrent its strength is undefined",
        ),
    )
    photon_noise_factor: float | Unset = parameter(
        2.0,
        "power of that noise over the shot noise of the photocurrent alone; a photoreceptor has at "
        "least 2",
        within=(1e-3, 1e6),
    )
    noise_rate_cov_decades: float | Unset = parameter(
        0.0,
        "spread of the leak and shot-noise rates over pixels: standard deviation of their log10",
        unit="decades",
        within=(0.0, 1.0),
        term=Term("rate_spread", "noise rates of its own for each pixel"),
    )
    refractory_period_s: float | Unset = parameter(
        0.0,
        "refractory period: time for which a pixel is blind after each event, in whole us; its "
        "reference is then set to the light at that time",
        unit="s",
        within=(0.0, 100.0),
        term=Term(
            "refractory",
            "pixels that are blind after an event",
            "a period of 0 would sample the reference anew after each event",
        ),
    )
    refractory_spread_decades: float | Unset = parameter(
        0.0,
        "spread of the refractory period over pixels: standard deviation of its log10 (fixed "
        "pattern); refractory_period_s is the mean",
        unit="decades",
        within=(0.0, 1.0),
        term=Term("refractory_spread", "a refractory period of its own for each pixel"),
    )
    hot_leak_median_hz: float | Unset = parameter(
        0.0,
        "warm and hot pixels: each pixel has this leak on top of leak_rate_hz, log-normal over "
        "pixels with this median and a long tail, at most 1 kHz; 0: off",
        unit="Hz",
        within=(0.0, 1e3),
        term=DEFECTS,
    )
    hot_leak_cov_decades: float | Unset = parameter(
        1.15,
        "spread of that leak over pixels: standard deviation of its log10",
        unit="decades",
        within=(0.0, 3.0),
    )
    dead_pixel_fraction: float | Unset = parameter(
        0.0,
        "fraction of dead pixels, which never fire",
        within=(0.0, 1.0),
        term=DEFECTS,
    )
    latency_us: float | Unset = parameter(
        0.0,
        "mean time from the threshold crossing to the pixel's readout request",
        unit="us",
        within=(0.0, 1e6),
    )
    latency_sigma_us: float | Unset = parameter(
        0.0,
        "standard deviation of the latency from event to event; latencies stay at or above 0",
        unit="us",
        within=(0.0, 1e6),
    )


@dataclass(frozen=True)
class ApsKeys(Generic[Unset]):
    """Active pixels: the intensity frames of a DAVIS."""

    enabled: bool | Unset = parameter(
        False,
        "true: the camera makes frames",
    )
    rate_hz: float | Unset = parameter(
        25.0,
        "frames per second; frame n begins at n / rate_hz in simulated time",
        unit="Hz",
        within=(1e-3, 1e5),
    )
    exposure_us: int | Unset = parameter(
        10_000,
        "exposure time of a row; motion during the exposure blurs",
        unit="us",
        within=(1, 10_000_000),
    )
    shutter: str | Unset = parameter(
        "global",
        "global: all rows expose at once | rolling: each row begins row_us after the one above it",
        choices=("global", "rolling"),
        noun="shutter",
    )
    row_us: float | Unset = parameter(
        0.0,
        "time to read out a row",
        unit="us",
        within=(0.0, 1e5),
    )
    gain: float | Unset = parameter(
        1.0,
        "gain; at 1, light of 255 DN (white of the event pixels) throughout the exposure gives "
        "full scale; brighter light is clipped",
        within=(1e-6, 1e6),
    )
    bits: int | Unset = parameter(
        8,
        "bits per pixel of the frame: 8 or 16; the bits of the ADC are the most significant ones",
    )
    adc_bits: int | Unset = parameter(
        10,
        "resolution of the ADC, bits",
        within=(1, 16),
    )
    full_well_e: float | Unset = parameter(
        0.0,
        "electrons of a white pixel; shot noise is the square root of the electrons; 0: no shot "
        "noise",
        unit="e",
        within=(0.0, 1e9),
    )
    read_noise_dn: float | Unset = parameter(
        0.0,
        "standard deviation of the read noise, in steps of the ADC; 0: none",
        unit="DN",
        within=(0.0, 65535.0),
    )
    crosstalk: float | Unset = parameter(
        0.0,
        "crosstalk into the event pixels: the amount by which the signal of a pixel rises for an "
        "instant when its row is read, before and after each exposure; pixels that reach their ON "
        "threshold fire; 0: none",
        unit="log units",
        within=(0.0, 1.0),
    )


@dataclass(frozen=True)
class ImuKeys(Generic[Unset]):
    """Accelerometer and gyroscope. Names and meanings are those of Kalibr, SI units."""

    enabled: bool | Unset = parameter(
        False,
        "true: the camera makes IMU samples",
    )
    rate_hz: float | Unset = parameter(
        1000.0,
        "samples per second; sample n is taken at n / rate_hz in simulated time",
        unit="Hz",
        within=(1e-3, 1e5),
    )
    accelerometer_bias: Vector | Unset = parameter(
        (0.0, 0.0, 0.0),
        "constant error of the axes x (right), y (down), z (forward)",
        unit="m/s^2",
        within=(-1e4, 1e4),
    )
    accelerometer_noise_density: float | Unset = parameter(
        0.0,
        "white noise: the standard deviation of a sample is this value times sqrt(rate_hz)",
        unit="m/s^2/sqrt(Hz)",
        within=(0.0, 1e4),
    )
    accelerometer_random_walk: float | Unset = parameter(
        0.0,
        "random walk of the bias: its standard deviation after T s is this value times sqrt(T)",
        unit="m/s^3/sqrt(Hz)",
        within=(0.0, 1e4),
    )
    accelerometer_range_g: float | Unset = parameter(
        0.0,
        "full scale of each axis, in standard gravities; larger values are clipped; 0: no limit",
        unit="g",
        within=(0.0, 1e4),
    )
    gyroscope_bias: Vector | Unset = parameter(
        (0.0, 0.0, 0.0),
        "constant error of the axes x, y, z",
        unit="rad/s",
        within=(-1e4, 1e4),
    )
    gyroscope_noise_density: float | Unset = parameter(
        0.0,
        "white noise, as for the accelerometer",
        unit="rad/s/sqrt(Hz)",
        within=(0.0, 1e4),
    )
    gyroscope_random_walk: float | Unset = parameter(
        0.0,
        "random walk of the bias, as for the accelerometer",
        unit="rad/s^2/sqrt(Hz)",
        within=(0.0, 1e4),
    )
    gyroscope_range_dps: float | Unset = parameter(
        0.0,
        "full scale of each axis; larger values are clipped; 0: no limit",
        unit="degrees/s",
        within=(0.0, 1e6),
    )
    temperature_c: float | Unset = parameter(
        25.0,
        "temperature that every sample reports",
        unit="degrees C",
        within=(-273.15, 1e4),
    )


@dataclass(frozen=True)
class ReadoutKeys(Generic[Unset]):
    """From pixel to packet."""

    order: str | Unset = parameter(
        "ideal",
        "ideal: every event at its own time | arbiter: requesting rows in turn (DAVIS) | scan: "
        "the whole array periodically, column by column (DVXplorer)",
        choices=("ideal", "arbiter", "scan"),
        noun="order of readout",
    )
    row_ns: int | Unset = parameter(
        0,
        "arbiter: time of a row access; all events of the row are stamped at its end",
        unit="ns",
        within=(0, 10**9),
    )
    column_ns: int | Unset = parameter(
        0,
        "arbiter: additional time per event of the row",
        unit="ns",
        within=(0, 10**9),
    )
    jitter_ns: float | Unset = parameter(
        0.0,
        "arbiter: standard deviation of the row access time",
        unit="ns",
        within=(0.0, 1e9),
    )
    phase_ns: int | Unset = parameter(
        0,
        "arbiter: the stamps of pixels are whole us; a request comes up to this time before its "
        "stamp, evenly spread. 999: at any time of its us, as in silicon | 0: at its end, so that "
        "rows never share a stamp",
        unit="ns",
        within=(0, 999),
    )
    scan_us: int | Unset = parameter(
        200,
        "scan: time between two scans, which begin at its multiples; a pixel gives at most one "
        "event per scan",
        unit="us",
        within=(1, 10**6),
    )
    scan_column_ns: int | Unset = parameter(
        0,
        "scan: time to read a column; an event is stamped when its column is read; 0: the whole "
        "array is read at once, and its stamps are multiples of scan_us",
        unit="ns",
        within=(0, 10**9),
    )
    scan_from: str | Unset = parameter(
        "left",
        "scan: the column that is read first. left: x rises | right: x falls",
        choices=("left", "right"),
        noun="side",
    )
    scan_every: int | Unset = parameter(
        1,
        "scan: reads one of this many scans and skips the others",
        within=(1, 10**6),
    )
    scan_events: int | Unset = parameter(
        0,
        "scan: events that are read within scan_us; a scan with n of them skips the next "
        "ceil(n / scan_events) - 1 scans; 0: any number",
        within=(0, 2**31),
    )
    erc_rate_mevs: float | Unset = parameter(
        0.0,
        "event rate control: highest event rate that passes; 0: off",
        unit="Mev/s",
        within=(0.0, 8000.0),
    )
    erc_period_us: int | Unset = parameter(
        200,
        "period over which event rate control counts events (OpenEB's default)",
        unit="us",
        within=(1, 10**6),
    )
    erc_drop: str | Unset = parameter(
        "time",
        "events that event rate control drops. time: evenly among all events | row, column: all "
        "events of some rows or columns",
        choices=("time", "row", "column"),
        noun="way to drop",
    )
    bandwidth_mevs: float | Unset = parameter(
        0.0,
        "bandwidth of the link; 0: unlimited",
        unit="Mev/s",
        within=(0.0, 8000.0),
    )
    fifo: int | Unset = parameter(
        65536,
        "events that may wait for the link; when it is full, further events are dropped",
        within=(1, 2**31),
    )
    stamp: str | Unset = parameter(
        "sent",
        "sent: an event is stamped when the link sends it | read: when it is read out; its stamp "
        "selects its packet, and the link only drops events",
        choices=("sent", "read"),
        noun="stamp",
    )
    roi: tuple[int, ...] | Unset = parameter(
        (),
        "regions of interest: x y width height of each rectangle; none: all pixels",
        unit="px",
    )
    mask: tuple[int, ...] | Unset = parameter(
        (),
        "pixels to switch off: x y of each, one after the other",
        unit="px",
    )
    mask_file: str | Unset = parameter(
        "",
        "a text file of pixels to switch off, one x y per line",
        is_path=any_path,
    )


@named_keywords
@dataclass(frozen=True)
@specialised
class ApsConfig(ApsKeys[None]):
    """[sensor.aps]: intensity frames and events, as in a DAVIS. None: the preset's value."""


@named_keywords
@dataclass(frozen=True)
@specialised
class ImuConfig(ImuKeys[None]):
    """[sensor.imu]: accelerometer and gyroscope at the camera. None: the preset's value.

    Names and meanings are those of Kalibr.
    """


@named_keywords
@dataclass(frozen=True)
@specialised
class ReadoutConfig(ReadoutKeys[None]):
    """[sensor.readout]: from pixel to packet. None: the preset's value."""


@dataclass(frozen=True)
class _Preset:
    preset: str = parameter(
        "davis346",
        "name of a file in config/sensors, or the path of your own file",
        is_path=path_or_name(".toml"),
    )


@named_keywords
@dataclass(frozen=True)
@specialised
class SensorConfig(PixelKeys[None], _Preset):
    """[sensor]: the event pixel. None: the preset's value. Names and meanings are those of v2e."""

    biases: BiasConfig = field(default_factory=BiasConfig)
    aps: ApsConfig = field(default_factory=ApsConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    readout: ReadoutConfig = field(default_factory=ReadoutConfig)
