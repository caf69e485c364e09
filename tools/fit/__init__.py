"""A sensor file of one's own camera, fitted to its recordings (`evs fit`)."""

from evs.tools.fit.bandwidth import fit_bandwidth
from evs.tools.fit.camera import FittedCamera, Light, fit_camera
from evs.tools.fit.estimate import CANNOT, Estimate, combined
from evs.tools.fit.frames import fit_frames
from evs.tools.fit.lamp import fit_lamp
from evs.tools.fit.laws import law_estimates
from evs.tools.fit.observed import Observed
from evs.tools.fit.period import find_period_s
from evs.tools.fit.ramp import PixelLeaks, RampThresholds, fit_ramp
from evs.tools.fit.readout import fit_readout
from evs.tools.fit.refractory import fit_refractory
from evs.tools.fit.replay import cut_to_frames, replayed
from evs.tools.fit.sensor_file import rounded, sensor_toml
from evs.tools.fit.still import Background, fit_still

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
