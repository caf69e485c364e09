"""What the states of all stages share: named arrays, compared bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

Arrays = Mapping[str, np.ndarray[Any, Any]]


def same_bytes(ours: Arrays, theirs: Arrays) -> bool:
    """Whether both have the same names, shapes and bits; a NaN equals itself."""
    return ours.keys() == theirs.keys() and all(
        array.shape == theirs[name].shape and array.tobytes() == theirs[name].tobytes()
        for name, array in ours.items()
    )
