"""The DVS pixels: log light against thresholds of their own, native, and their state, a value.

The contract stands in core/sensor: comparator.h and pixel.h. The slow oracle that gives the same
bytes is tests/support/reference/pixel.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import InitVar, dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from evs.emulator import _core
from evs.emulator.base.arrays import Arrays, on_lines, same_bytes
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor.aps_crosstalk import RowReads
from evs.emulator.sensor.fixed_pattern import FixedPattern, draw_pattern
from evs.emulator.sensor.parameters import ModelRequest, SensorParameters
from evs.emulator.sensor.running_mean import RunningMeanConstants
from evs.emulator.sensor.terms import TERMS, reduced, terms_of
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
            threads: Worker threads; 0: one per core.
            isa: auto, avx512, avx2, neon or portable, all with the same bytes.
            average: The running mean in front of the pixels; None: there is none.
            causes: Whether byte 13 of each event is its msgs.Cause; it is zero otherwise.
            switches: Terms that are forced on, with the same bytes, or off.

        Raises:
            EvsError: This machine cannot run the instruction set.
        """
        self.sensor = reduced(sensor, switches)
        average = average if switches.decide("running_mean", average) else None
        self.terms = terms_of(self.sensor, average is not None, causes, switches)
        """which terms the pixels have"""
        self._threads, self._isa, self._average = threads, isa, average
        aps = self.sensor.aps
        crosstalk = aps.enabled and aps.crosstalk > 0.0
        self._row_reads = RowReads(aps, self.sensor.height) if crosstalk else None
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
        return {name: name in self.terms for name in (*TERMS, "running_mean", "causes")}

    @property
    def adjustable(self) -> tuple[str, ...]:
        """EventModel.adjustable."""
        return ADJUSTABLE

    def take_over(self, state: PlainState, before: object) -> PlainState:
        """EventModel.take_over: the next tick is of these parameters, all before it was of those.

        A still pixel that a new threshold has passed fires in the next tick.
        """
        if not isinstance(before, PlainModel):
            raise EvsError("other event models cannot hand their pixels over; make another camera")
        # its pixels are made here: the next tick may have a clock to keep
        check_take_over(self, before, state.seed)
        before.array(state.seed).settle(state.clock_us, state.arrays())
        if state.shot_next is not None and state.ticks:
            gaps = rescaled_gaps(
                state.shot_next - state.clock_us * SHOT_UNITS,
                shot_bounds(before.pattern(state.seed)),
                shot_bounds(self.pattern(state.seed)),
            )
            state.shot_next[:] = np.minimum(state.clock_us * SHOT_UNITS + gaps, _NEVER)
        state.all_due = 1
        return state

    def pattern(self, seed: int) -> FixedPattern:
        """What every pixel has of its own under this seed."""
        seed %= 2**64
        if self._drawn is None or self._drawn[0] != seed:
            self._drawn = seed, draw_pattern(self.sensor, seed, self.terms)
        return self._drawn[1]

    def init(self, seed: int) -> PlainState:
        """The state before the first tick."""
        return self._dark(seed)

    def _dark(self, seed: int) -> PlainState:
        # the pixels are made here: the first tick may have a clock to keep
        shape = self.sensor.height, self.sensor.width
        return PlainState.dark(seed, shape, self.array(seed).state)

    def restore(self, saved: Arrays) -> PlainState:
        """EventModel.restore."""
        state = PlainState.restore(saved)
        fresh = self._dark(state.seed).arrays()
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
        pixels = self.array(state.seed)
        reads = None if self._row_reads is None else self._row_reads.within(t_begin_us, t_end_us)
        try:
            raw, clamped = pixels.step(
                np.ascontiguousarray(luminance, np.float32),
                t_begin_us,
                state.clock_us,
                tick_us,
                state.ticks,
                state.arrays(),
                row_reads=reads,
                all_due=bool(state.all_due),
            )
        except MemoryError:
            raise EvsError(
                f"the events up to {t_end_us} us do not fit in memory; raise the thresholds"
            ) from None
        except ValueError as reason:
            raise EvsError(
                f"sensor state is of another sensor: {reason}; call init again"
            ) from None
        state.all_due = 0
        state.clamped += clamped
        state.clock_us += tick_us
        state.tick_us = tick_us
        state.ticks += 1
        return raw.view(EVENT_DTYPE), state

    @property
    def has_row_reads(self) -> bool:
        """Whether the rows of frames that are read disturb the pixels."""
        return self._row_reads is not None

    def array(self, seed: int) -> _core.PixelArray:
        """The native pixels of this seed; the last ones are kept."""
        seed %= 2**64
        if self._built is None or self._built[0] != seed:
            self._built = seed, self._build(seed)
        return self._built[1]

    def _build(self, seed: int) -> _core.PixelArray:
        sensor, average = self.sensor, self._average
        # of 1 / us, for z = 2 pi f dt
        turn = 2.0 * math.pi * 1e-6
        span_lux = sensor.bright_lux + sensor.dim_lux
        settings = SimpleNamespace(
            log=sensor.log,
            exposure_dn=sensor.exposure_dn,
            dark_dn=sensor.dark_dn,
            linlog_dn=sensor.linlog_dn,
            log_eps=sensor.log_eps,
            euler=sensor.filter == "euler",
            large_signal=sensor.filter == "large_signal",
            lowpass_low=turn * sensor.cutoff_hz * sensor.dim_lux / span_lux,
            lowpass_slope=turn * sensor.cutoff_hz * sensor.lux_per_dn / span_lux,
            follower=turn * sensor.follower_hz,
            # a rate of 0 that is forced on changes nothing
            highpass=turn * sensor.highpass_hz or 1e-300 * ("high_pass" in self.terms),
            parasitic_slope=sensor.lux_per_dn / sensor.bright_lux,
            refractory_us=sensor.refractory_us,
            causes="causes" in self.terms,
            noise_gain=average.noise_gain if average else 0.0,
            drift_gain=average.drift_gain if average else 0.0,
            least_gain=average.least_gain if average else 0.0,
            noise_weight=average.noise_weight if average else 0.0,
            shot_bright=sensor.shot_noise_bright,
            shot_inverse=sensor.shot_noise_law == "inverse",
            shot_slope=sensor.lux_per_dn / span_lux,
            shot_offset=sensor.dim_lux / span_lux,
            shot_dim_dn=sensor.dim_lux / sensor.lux_per_dn,
            aps_crosstalk=sensor.aps.crosstalk if self._row_reads else 0.0,
            photon_scale=sensor.photon_scale_us,
            seed=seed,
        )
        return _core.PixelArray(
            settings, self.pattern(seed), sensor.width, sensor.height, self._threads, self._isa
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


ADJUSTABLE = (
    *("pos_thres", "neg_thres", "sigma_thres", "cutoff_hz", "follower_hz", "highpass_hz"),
    *("leak_rate_hz", "shot_noise_rate_hz", "refractory_period_s"),
)
"""keys of [sensor] that may change while pixels run; biases stand for some of them"""

SHOT_UNITS = 1024
"""of the clock of shot noise in a us: SHOT_UNITS of core/sensor/shot_noise.h"""

MAX_TICK_US = 2**28 - 1
"""Longest tick, about 4 minutes."""

MAX_CLOCK_US = 2**52 - 1
"""How long a sensor may live, 142 years: the clock of shot noise counts 2^-10 us in int64."""

BLOCK = 64
"""Pixels that the native core steps together: core/sensor/pixel.h."""

_LARGEST_LOG = 256.0
"""The logarithm of no float32 is larger, of either sign, nor is any reference."""

_NEVER = 2**62
"""A time that does not come: NEVER of core/sensor/shot_noise.h"""

_LEAST_BUDGET = 2.0**-46
"""Of photon noise: LEAST_BUDGET of core/sensor/photon_noise.h"""

_LOGS = ("reference", "last_log", "filtered", "followed")

I64 = np.ndarray[Any, np.dtype[np.int64]]


class StateArray(NamedTuple):
    """An array of the state of pixels."""

    name: str
    dtype: str
    pixels: int
    """that each of its numbers is of: 1, or BLOCK"""
    first: float
    """its value before the first light"""
    always: bool
    """whether it is there whatever terms are on"""

    def shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Its shape where the sensor has this one."""
        return shape if self.pixels == 1 else (-(-math.prod(shape) // self.pixels),)


STATE = tuple(StateArray(*row) for row in _core.pixel_state())
"""The table of core/sensor/pixel.h, which explains each array."""

_ARRAYS = tuple(array.name for array in STATE)
_NUMBERS = ("clamped", "clock_us", "tick_us", "ticks", "all_due")


class _Arrays:
    """What type checkers know of the arrays of STATE."""

    reference: F64
    last_log: F32
    last_luminance: F32

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> np.ndarray[Any, Any] | None: ...
        def __setattr__(self, name: str, value: Any) -> None: ...


@dataclass(eq=False)
class PlainState(_Arrays):
    """State of (h, w) pixels: the arrays of STATE are attributes, None where no term needs them.

    The fixed pattern follows from the seed and is not in it. The sensor's clock is the sum of the
    ticks so far.
    """

    seed: int
    """the fixed pattern and all noise follow from it"""
    values: InitVar[Mapping[str, Any]]
    """its arrays by name"""
    clamped: int = 0
    """pixels times ticks whose light was negative, NaN or Inf and was replaced by the last one"""
    clock_us: int = 0
    """sum of all ticks so far, us"""
    tick_us: int = 0
    """length of the last one, us"""
    ticks: int = 0
    """how many there were"""
    all_due: int = 0
    """1: parameters have changed since, so no block is left out in the next one"""

    def __post_init__(self, values: Mapping[str, Any]) -> None:
        for array in STATE:
            setattr(self, array.name, values.get(array.name))

    @classmethod
    def dark(cls, seed: int, shape: tuple[int, int], names: Collection[str]) -> PlainState:
        """Make the state of pixels that have seen no light yet.

        Args:
            seed: What fixed pattern and noise follow from.
            shape: (h, w).
            names: The arrays that they have.
        """
        return cls(
            seed,
            {
                array.name: on_lines(np.full(array.shape(shape), array.first, array.dtype))
                for array in STATE
                if array.name in names
            },
        )

    @property
    def clamps(self) -> int:
        """Everything that was replaced: light alone."""
        return self.clamped

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """The arrays that are there, by name: the live ones."""
        fields = vars(self)
        return {name: array for name in _ARRAYS if (array := fields[name]) is not None}

    def copy(self) -> PlainState:
        """A state of its own: stepping one does not touch the other."""
        copies = {name: on_lines(array) for name, array in self.arrays().items()}
        return PlainState(self.seed, copies, **{name: getattr(self, name) for name in _NUMBERS})

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that np.savez writes and `restore` takes back."""
        numbers = {name: np.array(getattr(self, name), np.int64) for name in _NUMBERS}
        arrays = {name: array.copy() for name, array in self.arrays().items()}
        return {**arrays, **numbers, "seed": np.array(self.seed % 2**64, np.uint64)}

    @classmethod
    def restore(cls, saved: Mapping[str, np.ndarray[Any, Any]]) -> PlainState:
        """The state that was saved. Raises EvsError where something of it is missing or unfit."""
        try:
            arrays = {
                array.name: on_lines(np.asarray(saved[array.name], array.dtype))
                for array in STATE
                if array.name in saved or array.always
            }
            numbers = {name: int(saved[name]) for name in ("seed", *_NUMBERS)}
        except KeyError as missing:
            raise EvsError(
                f"saved sensor state lacks {missing}; save it with PlainState.save"
            ) from None
        shape = arrays["reference"].shape
        shapes = {array.name: array.shape(shape) for array in STATE}
        if len(shape) != 2 or any(array.shape != shapes[name] for name, array in arrays.items()):
            raise EvsError("saved sensor state has arrays of different shapes; save it again")
        logs = [arrays[name] for name in _LOGS if name in arrays]
        if any(np.any(np.abs(log) > _LARGEST_LOG) for log in logs):
            raise EvsError(
                "saved sensor state is damaged: no log light is that large; save it again"
            )
        state = cls(values=arrays, **numbers)
        if not state._is_possible():
            raise EvsError("saved sensor state is damaged: its times are invalid; save it again")
        return state

    def _is_possible(self) -> bool:
        """Whether its counters and times are such as a sensor can have."""
        if not (0 <= self.clock_us <= MAX_CLOCK_US and 0 <= self.ticks <= MAX_CLOCK_US):
            return False
        if not 0 <= self.tick_us <= MAX_TICK_US or self.all_due not in (0, 1):
            return False
        times = [array for array in self.arrays().values() if array.dtype == np.int64]
        if any(np.any(np.abs(array) > _NEVER) for array in times):
            return False
        if np.any(np.isinf(self.last_luminance)) or not 0 <= self.clamped <= MAX_CLOCK_US * 2**11:
            return False
        # a pixel without a reference draws its budget anew
        budget = self.noise_budget
        if budget is not None and not np.all((budget >= _LEAST_BUDGET) | np.isnan(self.reference)):
            return False
        # of shot noise nothing is left over from ticks that are done
        due = self.shot_next is not None and bool(np.any(self.shot_next <= self.clock_us * 1024))
        counts = self.shot_count
        return not (due and self.clock_us) and not (counts is not None and bool((counts < 0).any()))

    def __eq__(self, other: object) -> bool:
        """Same bits everywhere; a NaN equals itself."""
        if not isinstance(other, PlainState):
            return NotImplemented
        if (self.seed - other.seed) % 2**64:
            return False
        if any(getattr(self, name) != getattr(other, name) for name in _NUMBERS):
            return False
        return same_bytes(self.arrays(), other.arrays())

    __hash__ = None  # type: ignore[assignment]


def check_take_over(now: PlainModel, before: PlainModel, seed: int) -> None:
    """Check that pixels can go on with the state of others.

    Raises:
        EvsError: A term that has a state is switched on or off; the message has its parameter.
    """
    causes = ["causes" in model.terms for model in (now, before)]
    if now.array(seed).state == before.array(seed).state and causes[0] == causes[1]:
        return
    for key in ADJUSTABLE:
        value = getattr(now.sensor, key)
        if bool(value) != bool(getattr(before.sensor, key)) and key != "sigma_thres":
            was = "over 0" if not value else "0"
            raise EvsError(
                f"sensor.{key} is {value:g} and was {was}: pixels that run do not get or lose a "
                "term; start the camera with a small value instead of 0"
            )
    raise EvsError("pixels that run do not get or lose a term; make another camera")


def shot_bounds(pattern: FixedPattern) -> F64:
    """The highest rate of shot noise of a pixel in each block, Hz."""
    assert pattern.shot_on is not None
    assert pattern.shot_off is not None
    rates = (pattern.shot_on.astype(np.float64) + pattern.shot_off).reshape(-1)
    bounds: F64 = np.maximum.reduceat(rates, np.arange(0, rates.size, BLOCK))
    return bounds


def rescaled_gaps(gaps: I64, before: F64, now: F64) -> I64:
    """The time that is left up to the next candidate of shot noise, at another rate.

    An exponential wait has no memory: what is left of it, times the ratio of the rates, is a wait
    at the new rate.

    Args:
        gaps: (blocks,) what is left, over 0, 2^-10 us.
        before: (blocks,) the rate of candidates until now.
        now: (blocks,) from now on.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.ceil(gaps * (before / now))
    # blocks of dead pixels have no candidates
    return np.where(scaled < _NEVER, scaled, _NEVER).astype(np.int64)


def check_tick(
    sensor: SensorParameters, luminance: F32, state: PlainState, t_begin_us: int, t_end_us: int
) -> None:
    """Raise EvsError where a tick cannot be stepped."""
    shape = (sensor.height, sensor.width)
    if np.shape(luminance) != shape:
        raise EvsError(f"luminance is {np.shape(luminance)}, the sensor (height, width) is {shape}")
    if state.reference.shape != shape:
        raise EvsError(
            f"sensor state is {state.reference.shape}, the sensor is {shape}; call init again"
        )
    if t_end_us <= t_begin_us:
        raise EvsError(f"tick ({t_begin_us}, {t_end_us}] us does not go forward")
    if t_end_us - t_begin_us > MAX_TICK_US:
        raise EvsError(
            f"tick of {t_end_us - t_begin_us} us is over {MAX_TICK_US} us; use shorter ones"
        )
    if not 0 <= state.clock_us <= MAX_CLOCK_US - (t_end_us - t_begin_us):
        raise EvsError(f"sensor clock is at {state.clock_us} us, past its end; call init again")


def log_light(luminance: F32, sensor: SensorParameters) -> F32:
    """Map luminance to log units, with the same bits as inside the event models.

    Args:
        luminance: Of any shape, linear, as in Renderer.render.
        sensor: The sensor, resolved.

    Returns:
        L_log, float32; NaN where the luminance is negative, NaN or Inf.
    """
    flat = np.ascontiguousarray(luminance, np.float32).reshape(-1)
    mapped: F32 = _core.log_map(
        flat,
        log=sensor.log,
        exposure_dn=sensor.exposure_dn,
        dark_dn=sensor.dark_dn,
        linlog_dn=sensor.linlog_dn,
        log_eps=sensor.log_eps,
    )
    return mapped.reshape(np.shape(luminance))
