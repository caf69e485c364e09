"""Actions: numbers -1 ... 1 scaled to the controls of the actuators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from evs.drivers.gym.library import spaces
from evs.msgs import EvsError, unknown

F64 = npt.NDArray[np.float64]


class Actions:
    """Box (nu,) float32 of -1 ... 1, scaled to each actuator's control range."""

    def __init__(
        self,
        names: Sequence[str],
        limits: F64,
        ranges: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        """Find the range of each actuator.

        Args:
            names: Names of the actuators.
            limits: (nu, 2) control ranges of the model.
            ranges: Name of an actuator -> (low, high), which replaces the model's.

        Raises:
            EvsError: An actuator has no range or does not exist, or there are none.
        """
        if not names:
            raise EvsError("the scene has no actuators, so there is nothing to control: add some")
        given = dict(ranges or {})
        for name in given:
            if name not in names:
                raise unknown("actuator", str(name), names)
        pairs = [
            _range(name, given.get(name, limit)) for name, limit in zip(names, limits, strict=True)
        ]
        low, high = np.array(pairs, np.float64).T
        self._middle, self._half = (low + high) / 2, (high - low) / 2
        self.space = spaces.Box(-1.0, 1.0, (len(names),), np.float32)

    def control(self, action: npt.ArrayLike) -> F64:
        """Convert an action to controls.

        Args:
            action: (nu,) numbers, clipped to -1 ... 1, or (n, nu) of many.

        Returns:
            Float64 controls of that shape.

        Raises:
            EvsError: The action has another shape.
        """
        values = np.asarray(action, np.float64)
        if values.ndim not in (1, 2) or values.shape[-1:] != self._middle.shape:
            raise EvsError(
                f"the action has shape {values.shape}, not {self._middle.shape}: "
                "give one number for each actuator"
            )
        return np.asarray(self._middle + self._half * np.clip(values, -1.0, 1.0), np.float64)


def _range(name: str, value: Sequence[float] | F64) -> tuple[float, float]:
    try:
        low, high = (float(end) for end in value)
    except (TypeError, ValueError):
        raise EvsError(f"the range of actuator '{name}' is {value!r}; give (low, high)") from None
    if np.isinf(low) or np.isinf(high):
        raise EvsError(
            f"actuator '{name}' has no ctrlrange: give it one in the model, or "
            f"control_range={{'{name}': (-1, 1)}}"
        )
    if not low < high:
        raise EvsError(f"the range of actuator '{name}' is {low:g} ... {high:g}: swap its ends")
    return low, high
