"""[sensor.biases]: the bias settings of real chips, under the names that their drivers use."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BiasConfig:
    """[sensor.biases]: the chip's own biases. None: the preset's value.

    A sensor accepts only the biases of its own chip. Each bias scales a parameter of the preset by
    the chip's law (emulator/sensor/presets/bias_laws.py).
    """

    bias_diff_on: int | None = None
    """IMX636, GenX320: ON threshold; higher is less sensitive"""
    bias_diff_off: int | None = None
    """IMX636, GenX320: OFF threshold; higher is less sensitive"""
    bias_fo: int | None = None
    """IMX636, GenX320: low-pass filter; higher is faster and noisier"""
    bias_hpf: int | None = None
    """IMX636, GenX320: high-pass filter; higher forgets sooner; 0: off"""
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
