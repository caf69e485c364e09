"""Events of a recording beside those that a sensor gives in the light of its frames."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from evs.msgs import Events
from evs_lab.fit.observed import I64, Mask
from evs_lab.metrics.counts import compare_rate_maps

BIN_US = 50_000
"""in which ON and OFF events are set against each other"""


@dataclass(frozen=True)
class Region:
    """The pixels and the time that are compared."""

    pixels: Mask
    """(height, width)"""
    begin_us: int
    """itself not inside"""
    end_us: int
    """itself inside"""

    def cut(self, events: Events) -> Events:
        """The events inside."""
        inside = (events["t"] > self.begin_us) & (events["t"] <= self.end_us)
        inside &= self.pixels[events["y"], events["x"]]
        return np.asarray(events[inside])


@dataclass(frozen=True)
class Likeness:
    """A sensor beside the recording, over the pixels of a region; NaN where nothing is defined."""

    events: int
    ratio: float
    """events for each event of the recording"""
    on: float
    """share of ON events"""
    active: float
    """share of pixels with an event"""
    totals: float
    """Pearson's correlation of the pixels' counts"""
    signed: float
    """Pearson's correlation of ON less OFF events, over pixels and bins of 50 ms"""
    kl_nats: float
    """Kullback-Leibler divergence of where the events are, the recording against the sensor"""

    def plain(self) -> dict[str, Any]:
        """For JSON: null in place of NaN."""
        return {key: None if value != value else value for key, value in asdict(self).items()}


def likeness(events: Events, real: Events, region: Region) -> Likeness:
    """Compare the events of a sensor with those of the recording.

    Args:
        events: (n,) EVENT_DTYPE of the sensor, times as the recording's
        real: (m,) of the recording
        region: what is compared
    """
    events, real = region.cut(events), region.cut(real)
    counts, of_real = (count_map(one, region) for one in (events, real))
    maps = compare_rate_maps(counts[None], of_real[None], 1e-6 * (region.end_us - region.begin_us))
    nothing = float("nan")
    return Likeness(
        events=len(events),
        ratio=len(events) / len(real) if len(real) else nothing,
        on=float(np.mean(events["p"] == 1)) if len(events) else nothing,
        active=float(np.mean(counts > 0)),
        totals=maps.correlation,
        signed=_signed(events, real, region),
        kl_nats=maps.kl_nats,
    )


def count_map(events: Events, region: Region) -> I64:
    """(pixels of the region,) events of each; the events are inside."""
    shape = region.pixels.shape
    cell = events["y"].astype(np.int64) * shape[1] + events["x"]
    return np.bincount(cell, minlength=region.pixels.size)[region.pixels.reshape(-1)].astype(
        np.int64
    )


def _signed(events: Events, real: Events, region: Region) -> float:
    """Correlation over all pixels and bins, of which most are empty and never made."""
    both = [(events, 0), (real, 1)]
    cells, inverse = np.unique(
        np.concatenate([_cell(one, region) for one, _ in both]), return_inverse=True
    )
    owner = np.concatenate([np.full(len(one), side) for one, side in both])
    sign = np.concatenate([np.where(one["p"] == 1, 1.0, -1.0) for one, _ in both])
    x, y = (
        np.bincount(inverse[owner == side], sign[owner == side], minlength=len(cells))
        for side in (0, 1)
    )
    bins = -(-(region.end_us - region.begin_us) // BIN_US)
    n = bins * int(region.pixels.sum())
    covariance = x @ y / n - x.sum() * y.sum() / n**2
    spread = [one @ one / n - (one.sum() / n) ** 2 for one in (x, y)]
    return float(covariance / np.sqrt(spread[0] * spread[1])) if min(spread) > 0 else float("nan")


def _cell(events: Events, region: Region) -> I64:
    height, width = region.pixels.shape
    late = (events["t"].astype(np.int64) - region.begin_us - 1) // BIN_US
    return np.asarray((late * height + events["y"]) * width + events["x"], np.int64)
