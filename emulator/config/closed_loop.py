"""The configuration of a closed loop: what delays, loses and ends it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from evs.msgs import EvsError


@dataclass(frozen=True)
class DelayConfig:
    """[loop.delays]: the way between camera, controller and actuators.

    It comes on top of the sensor's own latency ([sensor] latency_us, [sensor.readout]).
    """

    transport_us: int = 0
    """from a tick's end to when its packet can be had, us: at the first decision from then on"""
    transport_jitter_us: float = 0.0
    """its standard deviation from packet to packet, us; none overtakes another"""
    drop_share: float = 0.0
    """share of packets that get lost on the way, 0 ... 1; they are counted"""
    control_us: int = 0
    """from a decision to its effect, us: it acts in the first tick that begins from then on"""
    control_jitter_us: float = 0.0
    """its standard deviation from decision to decision, us; none overtakes another"""


@dataclass(frozen=True)
class LimitConfig:
    """[[loop.limits]]: a range that a sensor of the model has to stay in. Any number of them."""

    sensor: str = ""
    """name of a <sensor> of the model"""
    low: float = -1e300
    """the episode is over when it reads less"""
    high: float = 1e300
    """or more"""


@dataclass(frozen=True)
class LoopConfig:
    """[loop]: the closed loop of pace = "lockstep"."""

    max_s: float | None = None
    """the episode is over after so much simulated time, s; None: it has no end"""
    limits: tuple[LimitConfig, ...] = ()
    delays: DelayConfig = field(default_factory=DelayConfig)

    def options(self) -> dict[str, Any]:
        """The arguments limits, max_s and delays of ClosedLoop and ClosedLoop.around.

        Raises:
            EvsError: A limit without a range, or a sensor with two.
        """
        names = [limit.sensor for limit in self.limits]
        for place, name in enumerate(names):
            if name in names[:place]:
                raise EvsError(f"at loop.limits.{place}.sensor: '{name}' has two limits; give one")
        for place, limit in enumerate(self.limits):
            if (limit.low, limit.high) == (LimitConfig.low, LimitConfig.high):
                raise EvsError(f"at loop.limits.{place}: no end; give low, high or both")
        limits = {limit.sensor: (limit.low, limit.high) for limit in self.limits}
        return {"limits": limits, "max_s": self.max_s, "delays": self.delays}
