"""Optics: lens distortion and vignetting, as tables for the tracer and as camera_info."""

from evs.emulator.optics.camera_info import camera_info
from evs.emulator.optics.distortion import MODELS, check_distortion, is_distorted, project
from evs.emulator.optics.lens import VIGNETTINGS, Lens, check_vignetting, make_lens

__all__ = [
    "MODELS",
    "VIGNETTINGS",
    "Lens",
    "camera_info",
    "check_distortion",
    "check_vignetting",
    "is_distorted",
    "make_lens",
    "project",
]
