"""The keeper: goes where the ball will be, as fast as its motor can."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from evs.examples.goalie.path import Crossing, EventBall, FrameBall
from evs.msgs import Observation

MASS_KG = 0.15
FORCE_N = 20.0
REACH_M = 0.28
"""As far as it goes to a side."""
SHARE = 0.8
"""Of its force that braking counts on; the rest corrects."""
FOLLOW_HZ = 30.0
"""How fast its speed follows the one that is wanted."""


class Keeper:
    """Forces for a paddle, from events or frames of a ball and the motor's encoder."""

    def __init__(self, frames: bool) -> None:
        """In: frames, it looks at frames, else at events."""
        self._ball: EventBall | FrameBall = FrameBall() if frames else EventBall()
        self.crossing: Crossing | None = None
        """where it believes that the ball will come"""

    def decide(self, seen: Observation) -> npt.NDArray[np.float64]:
        """(1,) N, for the next tick."""
        if isinstance(self._ball, EventBall):
            for packet in seen.packets:
                self._ball.see(packet.events, packet.time_end_us)
        else:
            for frame in seen.frames:
                self._ball.see(frame)
        self.crossing = self._ball.path.crossing(seen.t_us)
        # it waits in the middle
        y = 0.0 if self.crossing is None else self.crossing.y_m
        target = min(max(y, -REACH_M), REACH_M)
        return np.array([self._force(target - float(seen.position[0]), float(seen.velocity[0]))])

    def _force(self, way: float, velocity: float) -> float:
        """As fast as one may be and still stop there: v^2 = 2 a |way|, slower at the end."""
        brake = SHARE * FORCE_N / MASS_KG
        follow = 2.0 * math.pi * FOLLOW_HZ
        wanted = min(math.sqrt(2.0 * brake * abs(way)), 0.3 * follow * abs(way))
        force = MASS_KG * follow * (math.copysign(wanted, way) - velocity)
        return min(max(force, -FORCE_N), FORCE_N)
