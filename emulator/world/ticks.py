"""Exact ticks: the model's time step, subdivided so that whole steps fill a tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

from evs.msgs import EvsError

MAX_STEPS = 1_000_000
"""in a tick; more is a slip of the keyboard"""


@dataclass(frozen=True)
class Substeps:
    """How a tick is filled, and what that did to the model's time step."""

    tick_us: int
    """length of a tick, us"""
    count: int
    """physics steps a tick"""
    timestep_s: float
    """length of each of them, s"""
    model_timestep_s: float
    """the model's own, s"""

    def __str__(self) -> str:
        """The choice as a sentence."""
        asked, taken = f"{self.model_timestep_s * 1e3:g} ms", f"{self.timestep_s * 1e3:g} ms"
        steps = "1 physics step" if self.count == 1 else f"{self.count} physics steps"
        reason = "as the model has it" if self.kept else f"the model asks for {asked}{self._key()}"
        return f"{steps} of {taken} in each tick of {self.tick_us / 1e3:g} ms ({reason})"

    @property
    def kept(self) -> bool:
        """Whether the model's time step is as it was."""
        return math.isclose(self.timestep_s, self.model_timestep_s, rel_tol=1e-9)

    def _key(self) -> str:
        """The nearest tick that keeps the model's step, as a key; "" where there is none."""
        model_us = self.model_timestep_s * 1e6
        if not math.isclose(model_us, round(model_us), rel_tol=1e-9) or model_us < 0.5:
            return ""
        steps = max(1, round(self.tick_us / model_us))
        return f"; scene.tick_us={steps * round(model_us)} keeps it"


def fill_tick(tick_us: int, model_timestep_s: float) -> Substeps:
    """The fewest equal steps that fill a tick and are no longer than the model's own.

    Raises EvsError where the tick is not a positive whole number of microseconds.
    """
    if isinstance(tick_us, bool | str) or not float(tick_us).is_integer() or tick_us <= 0:
        raise EvsError(
            f"scene.tick_us is {tick_us}: a tick is a positive whole number of microseconds, "
            "for example 1000"
        )
    if not model_timestep_s > 0.0:
        raise EvsError(f"the model's timestep is {model_timestep_s} s: it must be over 0")

    # 1 ms over 0.1 ms is a little over 10 in floating point, and still 10
    tick_s = int(tick_us) * 1e-6
    if tick_s / model_timestep_s > MAX_STEPS * (1.0 + 1e-9):
        raise EvsError(
            f"the model's timestep is {model_timestep_s:g} s: a tick of {tick_us} us would take "
            f"{tick_s / model_timestep_s:.3g} steps; give <option timestep=.../> of "
            f"{tick_s / MAX_STEPS:g} s or more, or a shorter scene.tick_us"
        )
    count = max(1, math.ceil(tick_s / model_timestep_s * (1.0 - 1e-9)))
    return Substeps(int(tick_us), count, tick_s / count, float(model_timestep_s))
