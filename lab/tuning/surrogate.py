"""Surrogate: predict a quantity for all configurations from a few measured ones.

The logarithm (base 2) of a cost or an error is modelled as a sum of effects (renderer, samples,
edges, model, tick, threads), each with a prior, and a smooth rest within each family of
configurations. The prediction meets the measurements up to their noise, and is uncertain far from
all of them. Rasmussen and Williams, Gaussian Processes for Machine
Learning, section 2.7 (explicit basis functions with a Gaussian prior).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs_lab.tuning.space import RENDERERS, Candidate

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Effect:
    """Prior of an effect: its mean and its standard deviation, powers of two."""

    mean: float
    spread: float


EFFECTS = (
    *("all", "hybrid", "path", "direct samples", "hybrid samples", "path samples"),
    *("edges", "hybrid edges", "path edges"),
    *(
        "adaptive",
        "evsnet",
        "adaptive samples",
        "evsnet samples",
        "tick",
        "longer",
        "hybrid tick",
        "path tick",
        "adaptive tick",
    ),
    "one thread",
)
"""the sum's terms, in the order of `effects_of`"""


def effects_of(one: Candidate) -> list[float]:
    """How much of each effect a configuration has."""
    direct, hybrid, path = (float(one.renderer == name) for name in RENDERERS)
    adaptive, evsnet = (float(one.model == name) for name in ("adaptive", "evsnet"))
    samples, ticks = one.samples, one.ticks
    edges = float(one.antialiasing == "adaptive")
    return [
        1.0,
        hybrid,
        path,
        direct * samples,
        hybrid * samples,
        path * samples,
        edges,
        hybrid * edges,
        path * edges,
        adaptive,
        evsnet,
        adaptive * (samples - 2.0),
        evsnet * (samples - 2.0),
        ticks,
        max(0.0, ticks) ** 2,
        hybrid * ticks,
        path * ticks,
        adaptive * ticks,
        float(one.threads == 1),
    ]


COST = {
    "all": Effect(0.0, 6.0),
    "hybrid": Effect(1.5, 1.5),
    "path": Effect(1.0, 2.0),
    "direct samples": Effect(0.6, 0.3),
    "hybrid samples": Effect(0.65, 0.2),
    "path samples": Effect(0.85, 0.2),
    "edges": Effect(-0.5, 0.5),
    "hybrid edges": Effect(0.0, 0.3),
    "path edges": Effect(-0.5, 0.5),
    "adaptive": Effect(0.1, 0.3),
    "evsnet": Effect(0.5, 1.0),
    "adaptive samples": Effect(0.0, 0.05),
    "evsnet samples": Effect(-0.1, 0.1),
    "tick": Effect(-0.9, 0.2),
    "longer": Effect(0.0, 0.05),
    "hybrid tick": Effect(0.0, 0.1),
    "path tick": Effect(0.0, 0.1),
    "adaptive tick": Effect(0.0, 0.05),
    "one thread": Effect(0.6, 0.5),
}
"""of a simulated second: twice the samples cost nearly twice as much, twice the tick half; the
cached light of hybrid costs the same with any samples"""

ERROR = {
    "all": Effect(-2.0, 4.0),
    "hybrid": Effect(-1.0, 2.0),
    "path": Effect(0.0, 3.0),
    "direct samples": Effect(-0.3, 0.3),
    "hybrid samples": Effect(-0.25, 0.2),
    "path samples": Effect(-0.5, 0.25),
    "edges": Effect(0.1, 0.3),
    "hybrid edges": Effect(0.2, 0.3),
    "path edges": Effect(0.3, 0.4),
    "adaptive": Effect(-0.1, 0.7),
    "evsnet": Effect(0.3, 1.0),
    "adaptive samples": Effect(0.2, 0.2),
    "evsnet samples": Effect(0.2, 0.2),
    "tick": Effect(0.3, 0.4),
    "longer": Effect(0.1, 0.2),
    "hybrid tick": Effect(0.1, 0.3),
    "path tick": Effect(0.0, 0.2),
    "adaptive tick": Effect(0.3, 0.4),
    "one thread": Effect(0.0, 0.0),
}
"""four times the samples about halve it; threads change no event; the cached light of hybrid has no
noise that samples remove, and is later in longer ticks"""

REST = 0.35
"""standard deviation of what the effects do not explain, powers of two"""
REACH = 2.5
"""correlation length of that: doublings of samples or tick"""


class Surrogate:
    """A Gaussian process over configurations."""

    def __init__(self, effects: Mapping[str, Effect], noise: float) -> None:
        """Begin without measurements.

        Args:
            effects: the prior of each effect.
            noise: standard deviation of a measurement, powers of two.
        """
        self._mean = np.array([effects[name].mean for name in EFFECTS])
        self._variance = np.array([effects[name].spread for name in EFFECTS]) ** 2
        self._noise = noise
        self._known: list[Candidate] = []
        self._weights: F64 = np.zeros(0)
        self._root: F64 = np.zeros((0, 0))

    def fit(self, known: Sequence[Candidate], values: Sequence[float]) -> None:
        """Fit to measurements.

        Args:
            known: measured configurations.
            values: > 0, one of each configuration.
        """
        self._known = list(known)
        if not self._known:
            return
        rest = np.log2(np.asarray(values, np.float64)) - self._prior(self._known)
        covariance = self._covariance(self._known, self._known)
        noisy = covariance + self._noise**2 * np.eye(len(rest))
        self._root = np.linalg.cholesky(noisy).astype(np.float64)
        self._weights = np.linalg.solve(self._root.T, np.linalg.solve(self._root, rest))

    def at(self, candidates: Sequence[Candidate]) -> tuple[F64, F64]:
        """Predict the quantity and its standard deviation as a factor: (values, factors)."""
        mean = self._prior(candidates)
        effects = _matrix(candidates)
        variance = (effects**2 * self._variance).sum(axis=1) + REST**2
        if self._known:
            across = self._covariance(candidates, self._known)
            mean = mean + across @ self._weights
            seen = np.linalg.solve(self._root, across.T)
            variance = variance - (seen**2).sum(axis=0)
        return 2.0**mean, 2.0 ** np.sqrt(np.maximum(variance, 0.0))

    def _prior(self, candidates: Sequence[Candidate]) -> F64:
        prior: F64 = _matrix(candidates) @ self._mean
        return prior

    def _covariance(self, one: Sequence[Candidate], two: Sequence[Candidate]) -> F64:
        effects = (_matrix(one) * self._variance) @ _matrix(two).T
        place_one, place_two = (
            np.array([(c.samples, c.ticks, c.threads == 1) for c in some], np.float64)
            for some in (one, two)
        )
        away = np.abs(place_one[:, np.newaxis] - place_two[np.newaxis]).sum(axis=2) / REACH
        family_one, family_two = (
            np.array(["/".join(c.family) for c in some]) for some in (one, two)
        )
        same = family_one[:, np.newaxis] == family_two[np.newaxis]
        covariance: F64 = effects + REST**2 * np.exp(-away) * same
        return covariance


def _matrix(some: Sequence[Candidate]) -> F64:
    return np.array([effects_of(one) for one in some], np.float64).reshape(-1, len(EFFECTS))
