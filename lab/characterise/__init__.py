"""Characterise a virtual sensor from its events alone, as manufacturers do with real ones."""

from evs_lab.characterise.background import Background, measure_background
from evs_lab.characterise.bandwidth import Bandwidth, measure_bandwidth
from evs_lab.characterise.bench import Bench
from evs_lab.characterise.contrast import SCurve, Thresholds, measure_thresholds
from evs_lab.characterise.dynamic_range import DynamicRange, measure_dynamic_range
from evs_lab.characterise.latency import Latency, measure_latency
from evs_lab.characterise.peak_rate import PeakRate, measure_peak_rate
from evs_lab.characterise.quantity import Quantity
from evs_lab.characterise.ramp import RampThresholds, measure_ramp
from evs_lab.characterise.refractory import Refractory, measure_refractory
from evs_lab.characterise.suite import PIXELS, STEPS, Characterisation, characterise

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
