"""Codes of different lengths: where each begins."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def code_starts(lengths: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Where codes begin, in ascending order, if one begins at 0.

    The set of places that are reached from 0 doubles with each pass, so there are log2(n) of them.

    Args:
        lengths: (n,) the length of a code that begins here, 1 or more.

    Returns:
        (m,) places; the last code may end after n.
    """
    end = len(lengths)
    jump = np.minimum(np.arange(end) + lengths, end)
    jump = np.append(jump, end)
    reached = np.zeros(end + 1, np.bool_)
    reached[0] = True
    for _ in range(max(end, 1).bit_length()):
        reached[jump[reached]] = True
        jump = jump[jump]
    return np.flatnonzero(reached[:end])
