"""Validate a network on scenes that it was not trained on, for each variant of the light."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import partial

import jax
import numpy as np

from evs.emulator.base.scene import F32, U8
from evs_lab.training.network import THRESHOLD, Architecture, Parameters, stream
from evs_lab.training.training_examples import Prepared

AT_ONCE = 128
"""pixels"""
NEAR_TICKS = 3


@dataclass(frozen=True)
class Scores:
    """Scores of one variant of the light; NaN where the denominator is 0."""

    emd: float
    """the paper's equation 9, mean over pixels, as emulator.metrics.mean_emd; events"""
    on: float
    """ON events per true ON event"""
    off: float
    """OFF events per true OFF event"""
    spurious_hz: float
    """events of a pixel without true ones, per second"""
    recall: float
    """share of the true events with a predicted one of their polarity within 3 ticks"""

    def plain(self) -> dict[str, float | None]:
        """Values for JSON: NaN becomes None."""
        return {key: value if math.isfinite(value) else None for key, value in asdict(self).items()}


def predict(
    parameters: Parameters, architecture: Architecture, x: F32, start: F32, first: int = 0
) -> U8:
    """Run a network on all pixels.

    Args:
        parameters: weights of the network.
        architecture: of the network.
        x: (P, K) input of the network.
        start: (P,), V before the first.
        first: first stream tick that is returned.

    Returns:
        (P, 2, K - first) ON and OFF events.
    """
    found = []
    for begin in range(0, len(x), AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        # padded to one shape, so that it is compiled once
        short = AT_ONCE - len(x[part])
        padded = np.pad(x[part], ((0, short), (0, 0))), np.pad(start[part], (0, short))
        spikes = np.stack(_stream(parameters, *padded, architecture, first))
        found.append(spikes.astype(np.uint8).transpose(2, 0, 1)[: AT_ONCE - short])
    return np.concatenate(found)


@partial(jax.jit, static_argnums=(3, 4))
def _stream(
    parameters: Parameters,
    x: jax.Array,
    start: jax.Array,
    architecture: Architecture,
    first: int,
) -> tuple[jax.Array, jax.Array]:
    return stream(parameters, x, start, architecture, first)


def plain_events(x: F32, start: F32) -> U8:
    """Events of an ideal pixel on the same light, (P, 2, K), at most 255 a tick."""
    v = start.astype(np.float64)
    found = np.zeros((len(x), 2, x.shape[1]), np.uint8)
    for k in range(x.shape[1]):
        v += x[:, k] / THRESHOLD
        events = np.trunc(v)
        v -= events
        found[:, 0, k] = np.clip(events, 0, 255)
        found[:, 1, k] = np.clip(-events, 0, 255)
    return found


def compared(events: U8, true: U8, tick_us: int) -> Scores:
    """Scores of (P, 2, K) events against true ones of the same ticks."""
    found, wanted = events.astype(np.int64), true.astype(np.int64)
    running = np.cumsum(found - wanted, 2)
    backwards = running[:, :, -1:] - running + (found - wanted)
    emd = 0.5 * (np.abs(running).mean(2) + np.abs(backwards).mean(2)).sum(1).mean()
    counts, true_counts = found.sum((0, 2)), wanted.sum((0, 2))
    still = wanted.sum((1, 2)) == 0
    seconds = int(still.sum()) * wanted.shape[2] * tick_us * 1e-6
    matched = np.where(_near(found) > 0, wanted, 0).sum()
    return Scores(
        emd=float(emd),
        on=_ratio(counts[0], true_counts[0]),
        off=_ratio(counts[1], true_counts[1]),
        spurious_hz=_ratio(found[still].sum(), seconds),
        recall=_ratio(matched, wanted.sum()),
    )


def overall(scores: list[Scores]) -> float:
    """One number, lower is better: the geometric mean of the EMDs times one plus the count error.

    An arithmetic mean would be dominated by variants with much noise. The count error is the mean
    over variants of the worse polarity's, from 0 (right) to 1.
    """
    logs = [math.log(max(one.emd, 1e-6)) for one in scores]
    errors = [
        max((min(1.0, abs(r - 1.0)) for r in (one.on, one.off) if math.isfinite(r)), default=0.0)
        for one in scores
    ]
    return math.exp(sum(logs) / len(logs)) * (1.0 + sum(errors) / len(errors))


class Validation:
    """Held-out pixels, and the scores of `plain` and of silence on them."""

    def __init__(self, held_out: Prepared, architecture: Architecture, warm_ticks: int) -> None:
        self._data, self._architecture, self._warm = held_out, architecture, warm_ticks
        start, light = held_out.start, held_out.x[:, :, warm_ticks:]
        self.plain = [self._compare(plain_events(x, start)) for x in light]
        self.silence = self._compare(np.zeros_like(held_out.counts[:, :, warm_ticks:]))

    def scores(self, parameters: Parameters) -> list[Scores]:
        """Scores of a network for each variant."""
        data, first = self._data, self._warm + self._architecture.latency_ticks
        return [
            self._compare(predict(parameters, self._architecture, x, data.start, first))
            for x in data.x
        ]

    def _compare(self, events: U8) -> Scores:
        """Compare the first ticks that count: with latency the last ones have no output."""
        true = self._data.counts[:, :, self._warm :][:, :, : events.shape[2]]
        return compared(events, true, self._architecture.tick_us)


def _near(events: np.ndarray) -> np.ndarray:
    """Events within NEAR_TICKS before or after each tick."""
    padded = np.pad(events, ((0, 0), (0, 0), (NEAR_TICKS, NEAR_TICKS)))
    count = events.shape[2]
    return sum(
        (padded[:, :, shift : shift + count] for shift in range(2 * NEAR_TICKS + 1)),
        start=np.zeros_like(events),
    )


def _ratio(count: float, of: float) -> float:
    return float(count) / float(of) if of else math.nan
