"""The extremes: what breaks an emulator, done to this one, each with its bound and what came of it.

Tests run them at full length, `evs doctor` in their short form.
"""

from evs.drivers.extremes.extreme import Extreme, Outcome, Tried
from evs.drivers.extremes.groups import GROUPS, extremes_of
from evs.drivers.extremes.trying import run_extremes, try_extreme

__all__ = [
    "GROUPS",
    "Extreme",
    "Outcome",
    "Tried",
    "extremes_of",
    "run_extremes",
    "try_extreme",
]
