"""What the runtimes that compute every pixel share: front, FIFOs, BiLIF. All but the network."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import BiLIF, decay_tables
from evs.emulator.evsnet.graph_network import Network, held_at_rest
from evs.emulator.evsnet.state import NetworkState, check_arrays
from evs.emulator.evsnet.weights import MAX_STEP
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.reference.light import log_light
from evs.msgs import Events

_MOST = np.float32(MAX_STEP)


@dataclass(frozen=True)
class LogDelta:
    """Luminance to X_k = L_log(k) - L_log(k - 1), the paper's equation 1.

    Exposure and dark current are the sensor's, the knee is the network's.
    """

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


class DenseRuntime(ABC):
    """Keeps the last 6 inputs of each convolution: fifo0, fifo1, ... (channels in, 6, h w).

    A GraphNetwork may hold more or fewer ticks.
    """

    name: str

    def __init__(self, sensor: SensorParameters, weights: Network, most: int = 1) -> None:
        """Raises EvsError where the network's numbers make no sense on this sensor."""
        self.held = held_at_rest(weights)
        self._tick_us = weights.tick_us
        self.height, self.width = sensor.height, sensor.width
        self._log_delta = LogDelta.of(sensor, weights)
        self._bilif = BiLIF(
            np.float32(sensor.pos_thres / weights.threshold),
            np.float32(sensor.neg_thres / weights.threshold),
            decay_tables(weights.tau_s, weights.tick_us),
            most,
        )

    @abstractmethod
    def convolve(self, x: F32, fifos: list[F32]) -> tuple[F32, list[F32]]:
        """Compute the network without its BiLIF.

        Args:
            x: (ticks, pixels).
            fifos: Of each convolution (channels in, 6, pixels), oldest first.

        Returns:
            The currents (ticks, pixels), and the FIFOs after the chunk, which may be those given.
        """

    def own_arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """FIFOs full of what each convolution reads while light stands still."""
        pixels = self.height * self.width
        return {
            f"fifo{i}": np.repeat(held[:, :, np.newaxis], pixels, axis=2)
            for i, held in enumerate(self.held)
        }

    def check(self, state: NetworkState) -> None:
        """Raise EvsError unless the FIFOs in the state are of this network and sensor."""
        pixels = self.height * self.width
        shapes = [(*held.shape, pixels) for held in self.held]
        check_arrays(state, {f"fifo{i}": (np.float32, shape) for i, shape in enumerate(shapes)})

    def step(
        self, luminance: F32, state: NetworkState, begin_us: int, currents: F32 | None = None
    ) -> list[Events]:
        """Runtime.step."""
        x = self._log_delta.step(luminance, state)
        names = [f"fifo{i}" for i in range(len(self.held))]
        current, fifos = self.convolve(
            x.reshape(len(x), -1), [state.arrays[name] for name in names]
        )
        state.arrays.update(zip(names, fifos, strict=True))
        current = current.reshape(luminance.shape)
        if currents is not None:
            currents[:] = current
        events = []
        for k, tick in enumerate(current):
            begin = begin_us + k * self._tick_us
            found, clamped = self._bilif.step(
                tick, state.v, state.last, state.ticks, begin, self._tick_us
            )
            events.append(found)
            state.ticks += 1
            state.v_clamped += clamped
        return events
