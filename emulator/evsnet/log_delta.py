"""In front of the network: luminance to X_k = L_log(k) - L_log(k - 1), the paper's equation 1."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.graph_network import Network
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.evsnet.weights import MAX_STEP
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.reference.light import log_light

_MOST = np.float32(MAX_STEP)


@dataclass(frozen=True)
class LogDelta:
    """The log map: exposure and dark current are the sensor's, the knee is the network's."""

    sensor: SensorParameters

    @classmethod
    def of(cls, sensor: SensorParameters, weights: Network) -> LogDelta:
        """That of one network on one sensor."""
        return cls(replace(sensor, log="linlog", linlog_dn=weights.linlog_dn))

    def step(self, luminance: F32, state: NetworkState) -> F32:
        """X (ticks, h, w) of a chunk of light (ticks, h, w).

        A pixel's first light only sets its L_log: X = 0. Light that is negative, NaN, Inf or too
        strong for a float leaves the pixel at its last (X = 0) and is counted in state.clamped;
        an |X| over 20 is clamped and counted in state.x_clamped.
        """
        steps = np.empty(luminance.shape, np.float32)
        for frame, x in zip(luminance, steps, strict=True):
            x[:] = self._tick(frame, state)
        return steps

    def _tick(self, frame: F32, state: NetworkState) -> F32:
        last = state.last_log
        log = log_light(frame, self.sensor)
        usable = ~np.isnan(log)
        log = np.where(usable, log, last)
        # NaN - NaN and log - NaN: no light before this one
        change = np.where(np.isnan(last), np.float32(0), log - last)
        x: F32 = np.clip(change, -_MOST, _MOST)
        state.clamped += int(np.count_nonzero(~usable))
        state.x_clamped += int(np.count_nonzero(x != change))
        np.copyto(state.last_luminance, frame, where=usable)
        last[:] = log
        return x
