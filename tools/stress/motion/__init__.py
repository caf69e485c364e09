"""Stress cases of motion."""

from evs.tools.stress.motion import many, meshes, places, scales, speeds

CASES = (*speeds.CASES, *places.CASES, *many.CASES, *meshes.CASES, *scales.CASES)

__all__ = ["CASES"]
