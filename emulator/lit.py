"""Lit: the light that falls on one camera at one instant."""

from __future__ import annotations

from dataclasses import dataclass

from evs.emulator.scene import F32, CameraPose, SceneSnapshot


@dataclass(frozen=True)
class Lit:
    """One instant, and what a camera sees of it."""

    snapshot: SceneSnapshot
    pose: CameraPose
    """where the camera was"""
    luminance: F32
    """(h, w) float32, linear"""
    traced_fraction: float
    """share of the pixels that had to be traced for it, 0 ... 1"""
