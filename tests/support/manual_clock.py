"""A clock that a test sets."""

from __future__ import annotations


class ManualClock:
    """Stands still until a test moves it; sleeping on it moves it, too."""

    def __init__(self, now_s: float = 100.0) -> None:
        self.now_s = now_s
        self.slept: list[float] = []
        """every wait over zero, s"""

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        if seconds > 0:
            self.slept.append(seconds)
            self.now_s += seconds
