"""The configuration of a closed loop: its delays, its packet loss and the limits that end it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from evs.msgs import EvsError


@dataclass(frozen=True)
class DelayConfig:
    """[loop.delays]: the path between camera, controller and actuators.

    These delays add to the sensor's own latency ([sensor] latency_us, [sensor.readout]).
    """

    transport_us: int = 0
    """delay from the end of a tick until its packet is available, us; the first decision from then
    on receives it"""
    transport_jitter_us: float = 0.0
    """standard deviation of that delay from packet to packet, us; packets stay in order"""
    drop_share: float = 0.0
    """fraction of packets that are lost, 0 ... 1; lost packets are counted"""
    control_us: int = 0
    """delay from a decision to its effect, us; it acts in the first tick that begins from then
    on"""
    control_jitter_us: float = 0.0
    """standard deviation of that delay from decision to decision, us; decisions stay in order"""


@dataclass(frozen=True)
class LimitConfig:
    """[[loop.limits]]: a range that a sensor of the model must stay in. Any number of tables."""

    sensor: str = ""
    """name of a <sensor> of the model"""
    low: float = -1e300
    """the episode ends when the sensor reads less than this"""
    high: float = 1e300
    """the episode ends when the sensor reads more than this"""


@dataclass(frozen=True)
class LoopConfig:
    """[loop]: the closed loop of pace = "lockstep"."""

    max_s: float | None = None
    """simulated time after which the episode ends, s; None: no limit"""
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
                raise EvsError(f"at loop.limits.{place}: no bound; give low, high or both")
        limits = {limit.sensor: (limit.low, limit.high) for limit in self.limits}
        return {"limits": limits, "max_s": self.max_s, "delays": self.delays}
