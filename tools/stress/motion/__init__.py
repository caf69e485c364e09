"""The extremes of motion."""

from evs.tools.stress.motion import many, meshes, places, scales, speeds

EXTREMES = (*speeds.EXTREMES, *places.EXTREMES, *many.EXTREMES, *meshes.EXTREMES, *scales.EXTREMES)

__all__ = ["EXTREMES"]
