"""The goalkeeper: moves to where the ball will cross the line, as fast as its motor can."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from evs.examples.goalie.tracker import Crossing, EventBallTracker, FrameBallTracker
from evs.msgs import Observation

MASS_KG = 0.15
FORCE_N = 20.0
REACH_M = 0.28
"""range to each side"""
SHARE = 0.8
"""share of the force that is planned for braking; the rest corrects errors"""
FOLLOW_HZ = 30.0
"""bandwidth of the speed control"""


class Goalkeeper:
    """Forces for a paddle, from events or frames of a ball and the motor's encoder."""

    def __init__(self, frames: bool) -> None:
        """Begin without a ball.

        Args:
            frames: whether to track the ball by frames; else by events.
        """
        self._ball: EventBallTracker | FrameBallTracker = (
            FrameBallTracker() if frames else EventBallTracker()
        )
        self.crossing: Crossing | None = None
        """predicted crossing of the ball"""

    def decide(self, observation: Observation) -> npt.NDArray[np.float64]:
        """(1,) N, for the next tick."""
        if isinstance(self._ball, EventBallTracker):
            for packet in observation.packets:
                self._ball.update(packet.events, packet.time_end_us)
        else:
            for frame in observation.frames:
                self._ball.update(frame)
        self.crossing = self._ball.path.crossing(observation.t_us)
        # without a ball it waits in the middle
        y = 0.0 if self.crossing is None else self.crossing.y_m
        target = min(max(y, -REACH_M), REACH_M)
        return np.array(
            [self._force(target - float(observation.position[0]), float(observation.velocity[0]))]
        )

    def _force(self, way: float, velocity: float) -> float:
        """Follow the largest speed that can still stop: v^2 = 2 a |way|, slower near the end."""
        brake = SHARE * FORCE_N / MASS_KG
        follow = 2.0 * math.pi * FOLLOW_HZ
        wanted = min(math.sqrt(2.0 * brake * abs(way)), 0.3 * follow * abs(way))
        force = MASS_KG * follow * (math.copysign(wanted, way) - velocity)
        return min(max(force, -FORCE_N), FORCE_N)
