"""The calibrated count: what an event costs follows how many there are too many.

The paper's losses reward silence, and its count loss does not see that all pixels of a batch err to
one side. Here each variant of the light and each polarity has a price that every predicted event
pays: it rises while there are more events than the truth has, and falls, below zero as well, while
there are fewer (dual ascent for the constraint that the counts are equal, plus a proportional
part so that it does not swing).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evs.emulator.scene import F32, F64

MOST_PRICE = 0.4
"""events; a missed event costs 0.5 by the EMD: for less than that none is made up"""
MEMORY = 0.99
"""of the running counts, a step"""
PROPORTIONAL = 0.2
"""of the price: events per ratio"""


@dataclass
class Calibration:
    """Running counts and prices of every variant (V, 2), ON and OFF. A value: save its arrays."""

    predicted: F64
    true: F64
    integral: F64

    @classmethod
    def start(cls, variants: int) -> Calibration:
        """Nothing seen, nothing owed."""
        return cls(*(np.zeros((variants, 2)) for _ in range(3)))

    def prices(self) -> F32:
        """(V, 2), events; within +-MOST_PRICE."""
        price = self.integral + PROPORTIONAL * self._excess()
        return np.clip(price, -MOST_PRICE, MOST_PRICE).astype(np.float32)

    def update(self, variant: np.ndarray, predicted: F64, true: F64, rate: float) -> None:
        """After a step. In: variant (G,) of each group; (G, 2) its events; rate of the price."""
        seen = np.unique(variant)
        for running, now in ((self.predicted, predicted), (self.true, true)):
            held = running[seen] * MEMORY
            for row, which in enumerate(seen):
                held[row] += now[variant == which].sum(0)
            running[seen] = held
        raised = self.integral[seen] + rate * self._excess()[seen]
        self.integral[seen] = np.clip(raised, -MOST_PRICE, MOST_PRICE)

    def _excess(self) -> F64:
        """Count ratio less 1, within +-1; 0 where the truth has nothing yet."""
        ratio = self.predicted / np.maximum(self.true, 1.0)
        return np.where(self.true >= 1.0, np.clip(ratio - 1.0, -1.0, 1.0), 0.0)
