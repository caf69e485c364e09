"""The plain DVS pixel, native. Its contract stands in core/sensor: comparator.h and pixel.h.

The slow oracle that gives the same bytes is emulator/sensor/reference.
"""

from __future__ import annotations

import math

import numpy as np

from evs.emulator import _core
from evs.emulator.base.arrays import Arrays
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import F32
from evs.emulator.sensor.model_request import ModelRequest
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.pixel.fixed_pattern import FixedPattern, draw_pattern
from evs.emulator.sensor.pixel.running_mean import RunningMeanConstants
from evs.emulator.sensor.pixel.state import PlainState, check_tick
from evs.emulator.sensor.terms import SensorTerms, reduced
from evs.msgs import EVENT_DTYPE, Events, EvsError


class PlainModel:
    """EventModel `plain`: log light against per-pixel thresholds, sub-tick stamps.

    With a running mean in front of it, it is the model `adaptive`.
    """

    def __init__(
        self,
        sensor: SensorParameters,
        threads: int = 0,
        isa: str = "auto",
        *,
        average: RunningMeanConstants | None = None,
        causes: bool = False,
        switches: Switches = UNFORCED,
    ) -> None:
        """Set the pixels up; nothing is drawn yet.

        Args:
            sensor: The sensor, resolved.
            threads: Worker threads; 0: one a core.
            isa: auto, avx512, avx2 or portable, all with the same bytes.
            average: The running mean in front of the pixels; None: there is none.
            causes: Whether byte 13 of each event is its msgs.Cause; it is zero otherwise.
            switches: Terms that are forced on, with the same bytes, or off.

        Raises:
            EvsError: This machine cannot run the instruction set.
        """
        self.sensor = reduced(sensor, switches)
        average = average if switches.decide("running_mean", average) else None
        self.terms = SensorTerms.of(self.sensor, average is not None, causes, switches)
        """which terms the pixels have"""
        self._threads, self._isa, self._average = threads, isa, average
        # pure functions of the seed; the last are kept, without a circle back to this
        self._drawn: tuple[int, FixedPattern] | None = None
        self._built: tuple[int, _core.PixelArray] | None = None
        if isa != "auto" and isa not in _core.isa_available():
            raise EvsError(f"this machine cannot run instruction set '{isa}'; use auto")

    @property
    def latency_us(self) -> int:
        """None."""
        return 0

    @property
    def warm_up_ticks(self) -> int:
        """None: the first light is the reference, whatever its noise."""
        return 0

    @property
    def versions(self) -> dict[str, str]:
        """Code alone shapes its events."""
        return {}

    @property
    def features(self) -> dict[str, bool]:
        """Which terms its pixels have, by name."""
        return self.terms.features

    def pattern(self, seed: int) -> FixedPattern:
        """What every pixel has of its own under this seed."""
        seed %= 2**64
        if self._drawn is None or self._drawn[0] != seed:
            self._drawn = seed, draw_pattern(self.sensor, seed, self.terms)
        return self._drawn[1]

    def init(self, seed: int) -> PlainState:
        """The state before the first tick."""
        # drawn now: the first tick may have a clock to keep
        self._pixels(seed)
        return PlainState.dark(seed, self.sensor, self._average is not None, self.terms)

    def restore(self, saved: Arrays) -> PlainState:
        """EventModel.restore."""
        state = PlainState.restore(saved)
        fresh = self.init(state.seed).arrays()
        ours = {name: array.shape for name, array in state.arrays().items()}
        if ours != {name: array.shape for name, array in fresh.items()}:
            raise EvsError("saved sensor state is of another sensor; restore it into its own")
        return state

    def step(
        self, luminance: F32, state: PlainState, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, PlainState]:
        """Turn the light of one tick into events; a pixel's first light only sets its reference.

        Args:
            luminance: (h, w) float32, linear. Light that is negative, NaN or Inf leaves the pixel
                at its last value and is counted in `clamped`.
            state: It is consumed: its arrays become those of the state that is returned.
            t_begin_us: Where the tick begins, us.
            t_end_us: Where it ends, us.

        Returns:
            The events in (t_begin_us, t_end_us], sorted by t, ties in pixel order; the state.

        Raises:
            EvsError: Wrong shape, a tick that does not go forward, more events than memory.
        """
        check_tick(self.sensor, luminance, state, t_begin_us, t_end_us)
        tick_us = t_end_us - t_begin_us
        if state.due_us is not None and tick_us != state.tick_us:
            # filters that stand still in short ticks may move in a longer one
            state.due_us[:] = state.clock_us
        pixels = self._pixels(state.seed)
        try:
            raw, clamped = pixels.step(
                np.ascontiguousarray(luminance, np.float32),
                t_begin_us,
                state.clock_us,
                tick_us,
                state.ticks,
                **state.arrays(),
            )
        except MemoryError:
            raise EvsError(
                f"the events up to {t_end_us} us do not fit in memory; raise the thresholds"
            ) from None
        except ValueError as reason:
            raise EvsError(
                f"sensor state is of another sensor: {reason}; call init again"
            ) from None
        state.clamped += clamped
        state.clock_us += tick_us
        state.tick_us = tick_us
        state.ticks += 1
        return raw.view(EVENT_DTYPE), state

    def _pixels(self, seed: int) -> _core.PixelArray:
        seed %= 2**64
        if self._built is None or self._built[0] != seed:
            self._built = seed, self._build(seed)
        return self._built[1]

    def _build(self, seed: int) -> _core.PixelArray:
        sensor, pattern = self.sensor, self.pattern(seed)
        average = self._average
        # of 1 / us, for z = 2 pi f dt
        turn = 2.0 * math.pi * 1e-6
        span_lux = sensor.bright_lux + sensor.dim_lux
        settings = _core.PixelSettings(
            log=sensor.log,
            exposure_dn=sensor.exposure_dn,
            dark_dn=sensor.dark_dn,
            linlog_dn=sensor.linlog_dn,
            log_eps=sensor.log_eps,
            euler=sensor.filter == "euler",
            lowpass_low=turn * sensor.cutoff_hz * sensor.dim_lux / span_lux,
            lowpass_slope=turn * sensor.cutoff_hz * sensor.lux_per_dn / span_lux,
            follower=turn * sensor.follower_hz,
            # a rate of 0 that is forced on changes nothing
            highpass=turn * sensor.highpass_hz if sensor.highpass_hz else self.terms.idle_highpass,
            parasitic_slope=sensor.lux_per_dn / sensor.bright_lux,
            refractory_us=sensor.refractory_us,
            causes=self.terms.causes,
            noise_gain=average.noise_gain if average else 0.0,
            drift_gain=average.drift_gain if average else 0.0,
            least_gain=average.least_gain if average else 0.0,
            noise_weight=average.noise_weight if average else 0.0,
            shot_bright=sensor.shot_noise_bright,
            shot_inverse=sensor.shot_noise_law == "inverse",
            shot_slope=sensor.lux_per_dn / span_lux,
            shot_offset=sensor.dim_lux / span_lux,
            shot_dim_dn=sensor.dim_lux / sensor.lux_per_dn,
            seed=seed,
        )
        return _core.PixelArray(
            settings,
            sensor.width,
            sensor.height,
            theta_on=pattern.on,
            theta_off=pattern.off,
            leak=pattern.leak,
            parasitic=pattern.parasitic,
            phase=pattern.phase,
            hot=pattern.hot,
            shot_on=pattern.shot_on,
            shot_off=pattern.shot_off,
            threads=self._threads,
            isa=self._isa,
        )


def plain_model(request: ModelRequest, average: RunningMeanConstants | None = None) -> PlainModel:
    """The event model `plain`."""
    return PlainModel(
        request.sensor,
        request.threads,
        request.isa,
        average=average,
        causes=request.model.labels,
        switches=request.switches,
    )


def adaptive_model(request: ModelRequest) -> PlainModel:
    """The event model `adaptive`: `plain` with a running mean of the light in front of it."""
    return plain_model(request, RunningMeanConstants())
