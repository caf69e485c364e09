"""[sensor.biases]: the knobs of real chips, by the names that their drivers have for them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BiasConfig:
    """[sensor.biases]: the chip's own knobs. None: the preset's value; a sensor has its own only.

    Each scales a parameter of the preset by the chip's law (emulator/sensor/presets/bias_laws.py).
    """

    bias_diff_on: int | None = None
    """IMX636, GenX320: ON threshold; higher is less sensitive"""
    bias_diff_off: int | None = None
    """IMX636, GenX320: OFF threshold; higher is less sensitive"""
    bias_fo: int | None = None
    """IMX636, GenX320: low pass; higher is faster, and noisier"""
    bias_hpf: int | None = None
    """IMX636, GenX320: high pass; higher forgets sooner, 0 never"""
    bias_refr: int | None = None
    """IMX636, GenX320: refractory period; higher is shorter"""
    PrBp_coarse: int | None = None
    """DAVIS: photoreceptor, decade of its current; higher is faster"""
    PrBp_fine: int | None = None
    """DAVIS: photoreceptor, 1 ... 255 parts of 255 of the coarse current"""
    PrSFBp_coarse: int | None = None
    """DAVIS: source follower behind the photoreceptor; higher is faster"""
    PrSFBp_fine: int | None = None
    """DAVIS: source follower, fine"""
    DiffBn_coarse: int | None = None
    """DAVIS: change amplifier; ON and OFF thresholds are measured from it"""
    DiffBn_fine: int | None = None
    """DAVIS: change amplifier, fine"""
    ONBn_coarse: int | None = None
    """DAVIS: ON comparator; its current over DiffBn's sets the ON threshold"""
    ONBn_fine: int | None = None
    """DAVIS: ON comparator, fine"""
    OFFBn_coarse: int | None = None
    """DAVIS: OFF comparator; its current under DiffBn's sets the OFF threshold"""
    OFFBn_fine: int | None = None
    """DAVIS: OFF comparator, fine"""
    RefrBp_coarse: int | None = None
    """DAVIS: refractory period; higher is shorter"""
    RefrBp_fine: int | None = None
    """DAVIS: refractory period, fine"""
    bias_sensitivity: int | None = None
    """DVXplorer: 0 very low, 1, 2 default, 3, 4 very high: both contrast thresholds at once"""
    contrastThresholdOn: int | None = None  # noqa: N815
    """DVXplorer: ON threshold, 0 ... 17; higher is less sensitive"""
    contrastThresholdOff: int | None = None  # noqa: N815
    """DVXplorer: OFF threshold, 0 ... 17; higher is less sensitive"""
    Pr: int | None = None
    """DVS128: photoreceptor, share of the master current in 2^-24; higher is faster"""
    foll: int | None = None
    """DVS128: source follower; higher is faster"""
    diff: int | None = None
    """DVS128: change amplifier; the thresholds are measured from it"""
    diffOn: int | None = None  # noqa: N815
    """DVS128: ON comparator; higher is less sensitive"""
    diffOff: int | None = None  # noqa: N815
    """DVS128: OFF comparator; lower is less sensitive"""
    refr: int | None = None
    """DVS128: refractory period; higher is shorter"""
