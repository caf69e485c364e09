"""The bench: a sensor, a lamp that gives any pixel any illuminance, and a switch.

Nothing is read from the sensor but its events. Switching it on sets every pixel's reference to the
light of that moment, or somewhere between two leak events, as the sensor's model has it; with the
same seed it is the same sensor with the same noise each time.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.protocols import EventModel
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig
from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.pixel import MAX_TICK_US
from evs.msgs import Events, join_events

Mask = npt.NDArray[np.bool_]
F64 = npt.NDArray[np.float64]
MakeModel = Callable[[SensorParameters], EventModel]


class Bench:
    """A sensor to be measured; `start` switches it on."""

    def __init__(
        self,
        sensor: SensorParameters,
        seed: int = 0,
        threads: int = 0,
        make: MakeModel | None = None,
    ) -> None:
        """Put a sensor on the bench.

        Args:
            sensor: its parameters.
            seed: of its noise.
            threads: worker threads; 0: one per core.
            make: builds the event model; None: `plain`.
        """
        self.sensor, self.seed, self.threads = sensor, seed, threads
        self._make = make or (lambda s: make_event_model(s, ModelConfig(), threads))
        self._model = self._make(sensor)
        # luminance of one lux
        self._per_lux = 1.0 / (sensor.lux_per_dn * sensor.exposure_dn)

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.sensor.width * self.sensor.height

    def part(self, pixels: int, **changes: Any) -> Bench:
        """A bench with the upper left corner of the same sensor.

        Args:
            pixels: at most so many.
            changes: of the sensor's parameters, as an experimenter sets biases.
        """
        return Bench(
            dataclasses.replace(corner(self.sensor, pixels), **changes),
            self.seed,
            self.threads,
            self._make,
        )

    def start(self, lux: float | F64, us: int = 1) -> LightExposure:
        """Switch the sensor on in this light and wait.

        Args:
            lux: a number, or (h w,) one for each pixel.
            us: how long to wait.
        """
        exposure = LightExposure(self, self._model, self._model.init(self.seed), 0)
        exposure.expose(lux, us)
        return exposure

    def luminance(self, lux: float | F64) -> npt.NDArray[np.float32]:
        """(h, w) luminance on the sensor at an illuminance, a number or (h w,)."""
        shape = (self.sensor.height, self.sensor.width)
        if isinstance(lux, np.ndarray):
            return (lux * self._per_lux).astype(np.float32).reshape(shape)
        return np.full(shape, lux * self._per_lux, np.float32)


@dataclass
class LightExposure:
    """A sensor that is on."""

    bench: Bench
    model: EventModel
    state: Any
    t_us: int

    def expose(self, lux: float | F64, us: int) -> Events:
        """The events of the next `us` microseconds, in which the light goes to `lux`.

        They are one tick, or several if that were longer than MAX_TICK_US, four minutes.

        Args:
            lux: a number or (h w,).
            us: duration.
        """
        light = self.bench.luminance(lux)
        parts = []
        while us > 0:
            tick_us = min(us, MAX_TICK_US)
            begin, self.t_us, us = self.t_us, self.t_us + tick_us, us - tick_us
            events, self.state = self.model.step(light, self.state, begin, self.t_us)
            parts.append(events)
        return parts[0] if len(parts) == 1 else join_events(parts)

    def copy(self) -> LightExposure:
        """A copy of the sensor in its present state."""
        return LightExposure(self.bench, self.model, self.state.copy(), self.t_us)


def corner(sensor: SensorParameters, pixels: int) -> SensorParameters:
    """The upper left corner of a sensor, of about its shape: at most so many pixels."""
    total = sensor.width * sensor.height
    if total <= pixels:
        return sensor
    width = max(1, min(sensor.width, round(sensor.width * math.sqrt(pixels / total))))
    return dataclasses.replace(sensor, width=width, height=max(1, pixels // width))


def pixel_numbers(events: Events, sensor: SensorParameters) -> npt.NDArray[np.int64]:
    """(n,) number of the pixel of each event, counted row by row."""
    numbers: npt.NDArray[np.int64] = events["y"].astype(np.int64) * sensor.width + events["x"]
    return numbers


def share_of(chosen: Mask, among: Mask) -> float:
    """Share of the pixels of `among` that were chosen too; 0 if `among` is empty."""
    total = int(np.count_nonzero(among))
    return int(np.count_nonzero(chosen & among)) / total if total else 0.0


def answered(events: Events, sensor: SensorParameters, on: bool) -> Mask:
    """(h w,) which pixels gave an event of this polarity."""
    mask = np.zeros(sensor.width * sensor.height, bool)
    mask[pixel_numbers(events[events["p"] == on], sensor)] = True
    return mask
