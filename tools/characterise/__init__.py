"""Characterise a virtual sensor by its events alone, as makers characterise real ones."""

from evs.tools.characterise.background import Background, measure_background
from evs.tools.characterise.bandwidth import Bandwidth, measure_bandwidth
from evs.tools.characterise.bench import Bench
from evs.tools.characterise.contrast import SCurve, Thresholds, measure_thresholds
from evs.tools.characterise.dynamic_range import DynamicRange, measure_dynamic_range
from evs.tools.characterise.latency import Latency, measure_latency
from evs.tools.characterise.peak_rate import PeakRate, measure_peak_rate
from evs.tools.characterise.quantity import Quantity
from evs.tools.characterise.ramp import RampThresholds, measure_ramp
from evs.tools.characterise.refractory import Refractory, measure_refractory
from evs.tools.characterise.suite import PIXELS, STEPS, Characterisation, characterise

__all__ = [
    "PIXELS",
    "STEPS",
    "Background",
    "Bandwidth",
    "Bench",
    "Characterisation",
    "DynamicRange",
    "Latency",
    "PeakRate",
    "Quantity",
    "RampThresholds",
    "Refractory",
    "SCurve",
    "Thresholds",
    "characterise",
    "measure_background",
    "measure_bandwidth",
    "measure_dynamic_range",
    "measure_latency",
    "measure_peak_rate",
    "measure_ramp",
    "measure_refractory",
    "measure_thresholds",
]
