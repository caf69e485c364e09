"""Draft: a scene that is being written, and how numbers for it are drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.config import FlickerConfig

DURATION_S = 0.448
"""of the usual 448 ticks; it limits how far things may move"""
SPEEDS = (0.1, 10.0, 300.0, 5000.0)
"""px/s: what hardly moves, what robots see, what flies past"""
SHARES = (0.2, 0.5, 0.3)
"""shares of the draws between these speeds"""
SLOWEST, FASTEST = SPEEDS[0], SPEEDS[-1]


@dataclass
class Draft:
    """The parts of an MJCF file so far."""

    rng: np.random.Generator
    assets: list[str] = field(default_factory=list)
    bodies: list[str] = field(default_factory=list)
    """of the world body, in order; the joints' order is theirs"""
    velocity: list[float] = field(default_factory=list)
    """qvel of all joints so far"""
    files: dict[str, bytes] = field(default_factory=dict)
    flicker: list[FlickerConfig] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    """requested speed of each thing that moves, px/s"""
    tags: list[str] = field(default_factory=list)
    """properties of the scene, for its meta data"""
    visual: str = ""
    gravity: float = 0.0
    """m/s^2, downwards"""
    _names: int = 0

    def name(self, stem: str) -> str:
        """A unique name."""
        self._names += 1
        return f"{stem}{self._names}"

    def chance(self, share: float) -> bool:
        """True in this share of the draws."""
        return bool(self.rng.random() < share)

    def uniform(self, low: float, high: float) -> float:
        """Uniform between two numbers."""
        return float(self.rng.uniform(low, high))

    def log_uniform(self, low: float, high: float) -> float:
        """Log-uniform between two positive numbers."""
        return math.exp(self.uniform(math.log(low), math.log(high)))

    def integer(self, low: int, high: int) -> int:
        """Uniform integer from low to high, both included."""
        return int(self.rng.integers(low, high + 1))

    def choice(self, words: Sequence[str], shares: Sequence[float] | None = None) -> str:
        """One of these words."""
        weights = None if shares is None else np.array(shares) / sum(shares)
        return str(words[int(self.rng.choice(len(words), p=weights))])

    def direction(self) -> F64:
        """A random unit vector, (3,), isotropic."""
        vector = self.rng.normal(size=3)
        return np.asarray(vector / max(1e-9, float(np.linalg.norm(vector))))

    def speed(self) -> float:
        """An image speed, px/s, over its whole range; log-uniform in each part of it."""
        pick = int(self.rng.choice(len(SHARES), p=SHARES))
        return self.log_uniform(SPEEDS[pick], SPEEDS[pick + 1])


def num(*values: float) -> str:
    """Format numbers as an MJCF attribute."""
    return " ".join(f"{float(value) + 0.0:.6g}" for value in values)


def encoded(linear: float) -> float:
    """A linear value as the display code of sRGB (IEC 61966-2-1)."""
    value = min(max(linear, 0.0), 1.0)
    return 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055
