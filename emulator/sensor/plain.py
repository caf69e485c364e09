"""The plain DVS pixel, native. Its numerical contract stands in core/sensor/pixel.h.

The slow oracle that gives the same bytes is emulator/sensor/reference.py.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from evs.emulator import _core
from evs.emulator.scene import F32
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.state import PlainState, check_tick
from evs.emulator.sensor.thresholds import Thresholds, draw_thresholds
from evs.msgs import EVENT_DTYPE, Events, EvsError


class PlainModel:
    """EventModel `plain`: log light against per-pixel thresholds, sub-tick stamps."""

    def __init__(self, sensor: SensorParameters, threads: int = 0, isa: str = "auto") -> None:
        """Threads: 0 is one a core. isa: auto, avx512, avx2, portable, all with the same bytes."""
        self.sensor = sensor
        # thresholds are a pure function of the seed; the last ones are kept
        self._thresholds = lru_cache(maxsize=1)(self._draw)
        try:
            self._native = _core.PlainSensor(
                width=sensor.width,
                height=sensor.height,
                log=sensor.log,
                exposure_dn=sensor.exposure_dn,
                dark_dn=sensor.dark_dn,
                linlog_dn=sensor.linlog_dn,
                log_eps=sensor.log_eps,
                threads=threads,
                isa=isa,
            )
        except ValueError as reason:
            raise EvsError(str(reason)) from None

    def thresholds(self, seed: int) -> Thresholds:
        """Every pixel's thresholds under this seed."""
        return self._thresholds(seed % 2**64)

    def init(self, seed: int) -> PlainState:
        """The state before the first tick."""
        return PlainState.dark(seed, self.sensor.height, self.sensor.width)

    def step(
        self, luminance: F32, state: PlainState, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, PlainState]:
        """Events of the tick (t_begin_us, t_end_us], sorted by t, ties in pixel order.

        In: luminance (h, w) float32, linear. A pixel's first light only sets its reference.
        Light that is negative, NaN or Inf leaves the pixel at its last value and is counted in
        `clamped`. The state handed in is consumed: its arrays become those of the one handed out.
        Raises EvsError: wrong shape, tick that does not go forward, more events than memory.
        """
        check_tick(self.sensor, luminance, state, t_begin_us, t_end_us)
        thresholds = self.thresholds(state.seed)
        try:
            raw, clamped = self._native.step(
                np.ascontiguousarray(luminance, np.float32),
                thresholds.on,
                thresholds.off,
                state.reference,
                state.last_log,
                state.last_luminance,
                t_begin_us,
                t_end_us - t_begin_us,
            )
        except MemoryError:
            raise EvsError(
                f"the events up to {t_end_us} us do not fit in memory; raise the thresholds"
            ) from None
        state.clamped += clamped
        return raw.view(EVENT_DTYPE), state

    def _draw(self, seed: int) -> Thresholds:
        return draw_thresholds(self.sensor, seed)
