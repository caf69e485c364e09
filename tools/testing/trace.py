"""Trace: the record of one episode of a controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs import EvsError, unknown

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Trace:
    """One seed's episode. n decisions, n + 1 moments: the start, and after each decision."""

    seed: int
    t_us: I64
    """(n + 1,) simulated time of each moment, us"""
    sensors: dict[str, F64]
    """name of a <sensor> of the model -> (n + 1, its dimension)"""
    ctrl: F64
    """(n, nu) what was decided at the first n moments; NaN: to keep the last"""
    compute_s: F64
    """(n,) how long the controller took for it, wall clock"""
    events: int
    """events that all cameras made"""
    done: str
    """why it ended before its time; "": it did not"""
    start: Any
    """everything that it began with, as Loop.save has it"""

    @property
    def t_s(self) -> F64:
        """(n + 1,) the same in s."""
        return np.asarray(self.t_us * 1e-6, np.float64)

    def values(self, name: str) -> F64:
        """(n + 1, dimension) of a sensor; EvsError says which there are."""
        if name not in self.sensors:
            raise unknown("sensor", name, self.sensors)
        return self.sensors[name]

    def value(self, name: str) -> F64:
        """(n + 1,) of a sensor with one dimension; EvsError where it has more."""
        values = self.values(name)
        if values.shape[1] != 1:
            raise EvsError(f"sensor '{name}' has {values.shape[1]} numbers: use values('{name}')")
        return values[:, 0]
