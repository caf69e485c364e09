"""What the environments of the examples share: cameras, drawn starts and pushes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from evs.emulator.config import ApsConfig, SensorConfig
from evs.emulator.simulation.closed_loop import ClosedLoop
from evs.emulator.world import MjData
from evs.msgs import Observation

LONGEST_US = 5000
"""longest exposure of a slow camera, which is enough in bright light"""


class SeededLoop(ClosedLoop, ABC):
    """A closed loop whose seed draws the start of an episode."""

    def reset(
        self,
        seed: int | None = None,
        keyframe: str = "",
        state: bool = False,
        start: Callable[[MjData], None] | None = None,
        sensor: str | SensorConfig | None = None,
        scene: Mapping[str, float] | None = None,
        must_run: bool = False,
    ) -> Observation:
        """Reset as ClosedLoop does; without `start`, the seed draws one.

        Args:
            seed: None is 0.
            keyframe: keyframe of the model to start from.
            state: whether the observation holds the full state.
            start: sets the state in place of the drawn one.
            sensor: another sensor for every camera.
            scene: values of the scene.
            must_run: whether an episode that is over at once is an error.

        Returns:
            The first observation.
        """
        seed = seed or 0
        drawn = self._draw_start(np.random.default_rng(seed % 2**64))
        return super().reset(seed, keyframe, state, start or drawn, sensor, scene, must_run)

    @abstractmethod
    def _draw_start(self, random: np.random.Generator) -> Callable[[MjData], None]:
        """Draw a start; the function that is returned sets it."""


@dataclass(frozen=True)
class PushSchedule:
    """When a loop is pushed: at regular times, each push for as long."""

    first_tick: int
    every_ticks: int
    ticks: int = 10
    """how long each lasts, ticks of 1 ms"""

    @property
    def seconds(self) -> float:
        """How long each lasts, s."""
        return self.ticks * 1e-3

    def random(self, tick: int, seed: int) -> np.random.Generator | None:
        """Random numbers of the push that acts in the tick after `tick`; None: no push acts.

        They follow from the seed and the number of the push alone, and are the same in each of its
        ticks, so a restored loop continues with the same push.
        """
        number, since = divmod(tick - self.first_tick, self.every_ticks)
        if number < 0 or since >= self.ticks:
            return None
        return np.random.default_rng((seed % 2**64, number))


def sensor_of(fps: int) -> SensorConfig:
    """The sensor of an example: a DVS128 that gives events, or frames too.

    Args:
        fps: frames per second, without noise; 0: events alone. The exposure is half of the period,
            5 ms at most. A frame arrives one period after its begin, as from a camera on USB.
    """
    if not fps:
        return SensorConfig("dvs128")
    period_us = 1_000_000 // fps
    exposure_us = min(period_us // 2, LONGEST_US)
    row_us = (period_us - exposure_us) / 128
    return SensorConfig(
        "dvs128",
        aps=ApsConfig(
            enabled=True, rate_hz=float(fps), exposure_us=exposure_us, row_us=row_us, adc_bits=8
        ),
    )
