"""Calibration: a price for predicted events and a weight for each variant, from past batches.

The paper's losses reward silence, and its count loss does not see that all pixels of a batch err in
the same direction. Here each variant of the light and each polarity has a price that every
predicted event pays. It rises while there are more events than the truth has, and falls, also
below zero, while there are fewer: dual ascent for the constraint that the counts are equal, plus a
proportional part so that it does not oscillate.

The EMD of noisy light is a hundred times that of clean light, and would drown it. Balanced, each
variant's loss is divided by the root of its running mean: a compromise between the sum (noisy
light rules) and the product (clean light rules) of all variants' losses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32, F64

I32 = npt.NDArray[np.int32]

MOST_PRICE = 0.4
"""events; below the 0.5 that a missed event costs by the EMD, so that none is invented"""
LEAST_LOSS = 1e-3
"""events a pixel"""
MEMORY = 0.99
"""of the running counts, a step"""
PROPORTIONAL = 0.2
"""of the price: events per ratio"""


@dataclass
class Calibration:
    """Running sums of every variant; its arrays are its whole state."""

    predicted: F64
    """(V, 2) ON and OFF events"""
    true: F64
    """(V, 2)"""
    integral: F64
    """(V, 2) of the price"""
    loss: F64
    """(V, 2) sum of losses and of groups"""

    @classmethod
    def start(cls, variants: int) -> Calibration:
        """The state before the first step: all sums are 0."""
        return cls(*(np.zeros((variants, 2)) for _ in range(4)))

    def prices(self) -> F32:
        """Price of an event of each variant and polarity, (V, 2), events, within +-MOST_PRICE."""
        price = self.integral + PROPORTIONAL * self._excess()
        return np.clip(price, -MOST_PRICE, MOST_PRICE).astype(np.float32)

    def weights(self) -> F32:
        """Weight of each variant, (V,), mean 1: one over the root of its loss; 1 where unseen."""
        loss, groups = self.loss.T
        mean = loss / np.maximum(groups, 1e-9)
        inverse = np.where(groups > 0, 1.0 / np.sqrt(np.maximum(mean, LEAST_LOSS)), np.nan)
        if np.isnan(inverse).all():
            return np.ones(len(loss), np.float32)
        relative: F64 = inverse / np.nanmean(inverse)
        return np.nan_to_num(relative, nan=1.0).astype(np.float32)

    def update(self, variant: I32, loss: F64, predicted: F64, true: F64, rate: float) -> None:
        """Add the result of a step.

        Args:
            variant: (G,) of each group.
            loss: (G,).
            predicted: predicted events (G, 2).
            true: true events (G, 2).
            rate: how fast the price moves.
        """
        seen = np.unique(variant)
        counted = np.stack([loss, np.ones(len(loss))], 1)
        for running, now in (
            (self.predicted, predicted),
            (self.true, true),
            (self.loss, counted),
        ):
            sums = running[seen] * MEMORY
            for row, which in enumerate(seen):
                sums[row] += now[variant == which].sum(0)
            running[seen] = sums
        raised = self.integral[seen] + rate * self._excess()[seen]
        self.integral[seen] = np.clip(raised, -MOST_PRICE, MOST_PRICE)

    def _excess(self) -> F64:
        """Count ratio less 1, within +-1; 0 where the truth has nothing yet."""
        ratio = self.predicted / np.maximum(self.true, 1.0)
        return np.where(self.true >= 1.0, np.clip(ratio - 1.0, -1.0, 1.0), 0.0)
