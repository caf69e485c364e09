"""The bench: measures a virtual sensor as makers measure real ones, from its events alone."""

from evs.emulator.characterise.background import Background, measure_background
from evs.emulator.characterise.bandwidth import Bandwidth, measure_bandwidth
from evs.emulator.characterise.bench import Bench
from evs.emulator.characterise.contrast import SCurve, Thresholds, measure_thresholds
from evs.emulator.characterise.dynamic_range import DynamicRange, measure_dynamic_range
from evs.emulator.characterise.latency import Latency, measure_latency
from evs.emulator.characterise.peak_rate import PeakRate, measure_peak_rate
from evs.emulator.characterise.refractory import Refractory, measure_refractory
from evs.emulator.characterise.result import Result
from evs.emulator.characterise.suite import PIXELS, STEPS, Characterisation, characterise

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
    "Refractory",
    "Result",
    "SCurve",
    "Thresholds",
    "characterise",
    "measure_background",
    "measure_bandwidth",
    "measure_dynamic_range",
    "measure_latency",
    "measure_peak_rate",
    "measure_refractory",
    "measure_thresholds",
]
