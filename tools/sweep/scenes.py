"""The default scenes of a sweep."""

from __future__ import annotations

DEFAULT = {
    "dm_control/humanoid": "primitives, one soft lamp; the project's headline",
    "gymnasium/ant": "primitives over a checker, one soft lamp",
    "evs:config/scenes/pencil.xml": "ours: bright, hard edges, a camera of the model",
    "procedural/1": "meshes, dark, three lamps of some size, three bounces",
    "procedural/4": "meshes, dark, an area light, three bounces",
    "procedural/8": "primitives and a mesh, bright, three lamps",
}
"""scene -> why it is included"""

QUICK = ("dm_control/humanoid",)
