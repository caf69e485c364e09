"""The environment: shoots balls at a goal and measures how far each passes from the paddle."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from evs.emulator.base.protocols import Meter
from evs.emulator.world import MjData
from evs.examples.common.environment import SeededLoop, sensor_of
from evs.examples.goalie import TRACKERS
from evs.examples.goalie.controller import Goalkeeper
from evs.msgs import EvsError, Observation, unknown

SCENE = Path(__file__).parents[2] / "config" / "scenes" / "goalie.xml"

FROM_X_M = 1.1
GOAL_M = 0.25
"""largest distance of an aim from the middle of the goal"""
SAVES_M = 0.07
"""half of the paddle's width plus the radius of the ball"""

Watch = Callable[[Observation, Goalkeeper], None]
"""called after each tick of a shot"""


class GoalieLoop(SeededLoop):
    """The closed loop. The seed draws from where and to where the ball is shot."""

    def __init__(
        self,
        fps: int = 0,
        *,
        speed_m_s: float = 3.0,
        threads: int = 1,
        meter: Meter | None = None,
    ) -> None:
        """Build the scene.

        Args:
            fps: frames per second of the camera; 0: events alone.
            speed_m_s: of the ball.
            threads: threads that trace light.
            meter: measures the stages of a tick.
        """
        self.speed_m_s = speed_m_s
        super().__init__(
            str(SCENE),
            ("above",),
            sensor=sensor_of(fps),
            threads=threads,
            meter=meter,
            limits={"ball_x": (0.0, 2.0)},
            max_s=10.0,
        )

    def _draw_start(self, random: np.random.Generator) -> Callable[[MjData], None]:
        if not 0.2 <= self.speed_m_s <= 200.0:
            raise EvsError(f"a ball of {self.speed_m_s:g} m/s: give 0.2 ... 200")
        begin, aim = random.uniform(-GOAL_M, GOAL_M, 2)
        way = np.array([-FROM_X_M, aim - begin])

        def shot(data: MjData) -> None:
            data.joint("ball_x").qpos[:] = FROM_X_M
            data.joint("ball_y").qpos[:] = begin
            speed = self.speed_m_s * way / np.linalg.norm(way)
            data.joint("ball_x").qvel[:], data.joint("ball_y").qvel[:] = speed

        return shot

    @property
    def miss_m(self) -> float:
        """Distance of the ball from the middle of the paddle, across."""
        data = self.world.data
        return abs(float(data.joint("ball_y").qpos[0] - data.joint("paddle").qpos[0]))


class GoalieExperiment:
    """The loop with one tracker, for any number of shots."""

    def __init__(self, tracker: str) -> None:
        """Build the scene.

        Args:
            tracker: one of TRACKERS.

        Raises:
            EvsError: there is no such tracker.
        """
        if tracker not in TRACKERS:
            raise unknown("tracker", tracker, TRACKERS)
        self.fps = TRACKERS[tracker]
        self.loop = GoalieLoop(self.fps)

    def shoot(self, speed_m_s: float, seed: int, watch: Watch | None = None) -> float:
        """Shoot one ball.

        Args:
            speed_m_s: of the ball.
            seed: draws the shot, and the noise of the camera.
            watch: called after each tick.

        Returns:
            Distance of the ball from the middle of the paddle at the goal line, m.
        """
        keeper = Goalkeeper(frames=self.fps > 0)
        self.loop.speed_m_s = speed_m_s
        observation = self.loop.reset(seed)
        while not observation.done:
            observation = self.loop.step(keeper.decide(observation))
            if watch is not None:
                watch(observation, keeper)
        return self.loop.miss_m
