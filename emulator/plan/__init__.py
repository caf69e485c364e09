"""What a scene requires: the code paths that run, why, and what they cost (scene_plan)."""

from evs.emulator.plan.features import FEATURES, NAMES, NATIVE, UNFORCED, Feature, Switches

__all__ = ["FEATURES", "NAMES", "NATIVE", "UNFORCED", "Feature", "Switches"]
