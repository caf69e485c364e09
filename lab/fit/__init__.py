"""Fit a sensor file to recordings of your own camera (`evs fit`)."""

from evs_lab.fit.bandwidth import fit_bandwidth
from evs_lab.fit.camera import FittedCamera, Light, fit_camera
from evs_lab.fit.estimate import CANNOT, Estimate, combined
from evs_lab.fit.frames import fit_frames
from evs_lab.fit.lamp import fit_lamp
from evs_lab.fit.laws import law_estimates
from evs_lab.fit.observed import Observed
from evs_lab.fit.period import find_period_s
from evs_lab.fit.ramp import PixelLeaks, RampThresholds, fit_ramp
from evs_lab.fit.readout import fit_readout
from evs_lab.fit.refractory import fit_refractory
from evs_lab.fit.replay import cut_to_frames, replayed
from evs_lab.fit.sensor_file import rounded, sensor_toml
from evs_lab.fit.still import Background, fit_still

__all__ = [
    "CANNOT",
    "Background",
    "Estimate",
    "FittedCamera",
    "Light",
    "Observed",
    "PixelLeaks",
    "RampThresholds",
    "combined",
    "cut_to_frames",
    "find_period_s",
    "fit_bandwidth",
    "fit_camera",
    "fit_frames",
    "fit_lamp",
    "fit_ramp",
    "fit_readout",
    "fit_refractory",
    "fit_still",
    "law_estimates",
    "replayed",
    "rounded",
    "sensor_toml",
]
