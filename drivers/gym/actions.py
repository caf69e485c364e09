"""Actions of -1 ... 1 as controls of the actuators."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from evs.drivers.gym.library import spaces
from evs.emulator.world import MjModel
from evs.msgs import EvsError, unknown


class Actions:
    """Box (nu,) float32 of -1 ... 1, spread over each actuator's range of control."""

    def __init__(
        self, model: MjModel, ranges: Mapping[str, tuple[float, float]] | None = None
    ) -> None:
        """In: ranges, name of an actuator -> (low, high), instead of the model's ctrlrange.

        Raises EvsError for an actuator that has no range, or does not exist, or for none at all.
        """
        if not model.nu:
            raise EvsError("the scene has no actuators, so there is nothing to act with: add some")
        names = [model.actuator(index).name or str(index) for index in range(model.nu)]
        given = dict(ranges or {})
        for name in given:
            if name not in names:
                raise unknown("actuator", name, names)
        low, high = np.empty(model.nu), np.empty(model.nu)
        for index, name in enumerate(names):
            if name not in given and not model.actuator_ctrllimited[index]:
                raise EvsError(
                    f"actuator '{name}' has no ctrlrange: give it one in the model, or "
                    f"control_range={{'{name}': (-1, 1)}}"
                )
            low[index], high[index] = given.get(name, model.actuator_ctrlrange[index])
            if not (np.isfinite([low[index], high[index]]).all() and low[index] < high[index]):
                raise EvsError(f"the range of actuator '{name}' is not (low, high): mend it")
        self._middle, self._half = (low + high) / 2, (high - low) / 2
        self.space = spaces.Box(-1.0, 1.0, (model.nu,), np.float32)

    def control(self, action: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """(nu,) float64 for an action; what is over 1 counts as 1. EvsError for another shape."""
        values = np.asarray(action, np.float64)
        if values.shape != self._middle.shape:
            raise EvsError(
                f"the action has shape {values.shape}, not {self._middle.shape}: "
                "give one number for each actuator"
            )
        return np.asarray(self._middle + self._half * np.clip(values, -1.0, 1.0), np.float64)
