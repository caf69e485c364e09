"""What a model has that is not shown, told in one line each, with what to do about it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence


class LeftOutWarning(UserWarning):
    """The model has something that is not shown; the message says what, and the fix."""


def warn_left_out(lines: Sequence[str]) -> None:
    """One LeftOutWarning a line, at the place that called who calls this."""
    for line in lines:
        warnings.warn(line, LeftOutWarning, stacklevel=4)
