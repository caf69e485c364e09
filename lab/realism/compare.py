"""A recording beside streams of other scenes: the distance of each statistic, and its floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import numpy as np

from evs_lab.fit import Observed
from evs_lab.realism.unpaired import QUANTITIES, Quantity, Statistics, distance, pieces

MOST_PIECES = 4
"""of a recording, evenly over it"""


@dataclass(frozen=True)
class Row:
    """One quantity."""

    quantity: Quantity
    values: tuple[float, ...]
    """of the recording, then of each stream; NaN for distributions"""
    floor: float
    """distance between two real pieces"""
    distances: tuple[float, ...]
    """of each stream"""

    def plain(self) -> dict[str, Any]:
        """For JSON: null in place of NaN."""
        return {
            "quantity": self.quantity.key,
            "unit": self.quantity.unit,
            "values": [_or_none(value) for value in self.values],
            "floor": _or_none(self.floor),
            "distances": [_or_none(value) for value in self.distances],
        }


def compare(
    real: Observed, streams: Sequence[Observed], again: Observed | None = None
) -> tuple[float, list[Row]]:
    """Statistics of pieces of one length.

    Args:
        real: A recording.
        streams: What is to be like it.
        again: Another recording of the same camera, for the floor; None: pieces of `real`.

    Returns:
        (length of the pieces, s; a row for each quantity)

    Raises:
        EvsError: The pieces have too few events.
    """
    whole = [real, *streams] + ([] if again is None else [again])
    seconds = min(one.seconds for one in whole)
    if again is None:
        seconds = min(seconds, 0.5 * real.seconds)
    of_real, *of_streams = (_spread(pieces(one, seconds)) for one in (real, *streams))
    pairs = list(
        combinations(of_real, 2)
        if again is None
        else product(of_real, _spread(pieces(again, seconds)))
    )
    return seconds, [
        Row(
            quantity,
            tuple(_value(quantity, each) for each in (of_real, *of_streams)),
            _distance(quantity, pairs),
            tuple(_distance(quantity, product(each, of_real)) for each in of_streams),
        )
        for quantity in QUANTITIES
    ]


def _spread(every: list[Statistics]) -> list[Statistics]:
    places = np.linspace(0, len(every) - 1, min(len(every), MOST_PIECES)).round().astype(int)
    return [every[k] for k in places]


def _value(quantity: Quantity, each: list[Statistics]) -> float:
    if quantity.low is not None:
        return float("nan")
    return float(np.mean([getattr(one, quantity.key) for one in each]))


def _distance(quantity: Quantity, pairs: Any) -> float:
    return float(np.mean([distance(quantity, a, b) for a, b in pairs]))


def _or_none(value: float) -> float | None:
    return None if value != value else value
