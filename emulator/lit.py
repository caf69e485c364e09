"""Lit: the light that falls on one camera at one instant."""

from __future__ import annotations

from typing import NamedTuple

from evs.emulator.scene import F32, CameraPose, SceneSnapshot


class Lit(NamedTuple):
    """One instant, and what a camera sees of it."""

    snapshot: SceneSnapshot
    pose: CameraPose
    """where the camera was"""
    luminance: F32
    """(h, w) float32, linear"""
    traced_fraction: float
    """share of the pixels that had to be traced for it, 0 ... 1"""
