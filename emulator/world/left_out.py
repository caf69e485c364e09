"""LeftOutWarning: what of a model or of an option is not shown."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence


class LeftOutWarning(UserWarning):
    """The model has something that is not shown; the message has what, and the fix."""


def warn_left_out(lines: Sequence[str]) -> None:
    """One LeftOutWarning a line, at the place outside the emulator that made the scene."""
    if not lines:
        return
    level, frame = 2, sys._getframe(1)
    while frame.f_back and str(frame.f_globals.get("__name__")).startswith("evs.emulator."):
        level, frame = level + 1, frame.f_back
    for line in lines:
        warnings.warn(line, LeftOutWarning, stacklevel=level)
