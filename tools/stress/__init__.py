"""The extremes: what breaks an emulator, done to this one, each with its bound and what came of it.

Tests run them at full length, `evs doctor` in their short form.
"""

from evs.tools.stress.extreme import Extreme, Outcome, Tried
from evs.tools.stress.groups import GROUPS, extremes_of
from evs.tools.stress.runner import run_extremes, try_extreme

__all__ = [
    "GROUPS",
    "Extreme",
    "Outcome",
    "Tried",
    "extremes_of",
    "run_extremes",
    "try_extreme",
]
