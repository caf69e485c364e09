"""What a scene requires: the code paths that run, why, and what they cost."""

from evs.emulator.plan.features import FEATURES, NAMES, UNFORCED, Feature, Switches

__all__ = ["FEATURES", "NAMES", "UNFORCED", "Feature", "Switches"]
