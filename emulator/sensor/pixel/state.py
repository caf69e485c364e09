"""PlainState: what a pixel array remembers from tick to tick. A value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from evs.emulator.base.arrays import on_lines, same_bytes
from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.terms import SensorTerms
from evs.msgs import EvsError

MAX_TICK_US = 2**28 - 1
"""Longest tick, about 4 minutes."""

MAX_CLOCK_US = 2**52 - 1
"""How long a sensor may live, 142 years: the clock of shot noise counts 2^-10 us in int64."""

BLOCK = 64
"""Pixels that the native core steps together: core/sensor/pixel.h."""

_LARGEST_LOG = 256.0
"""The logarithm of no float32 is larger, of either sign, nor is any reference."""

_NEVER = 2**62
"""A time that does not come: kNever of core/sensor/shot_noise.h"""

_LOGS = ("reference", "last_log", "filtered", "followed")

I64 = np.ndarray[Any, np.dtype[np.int64]]

_FRAMES = {
    "reference": np.float64,
    "last_log": np.float32,
    "last_luminance": np.float32,
    "filtered": np.float32,
    "followed": np.float32,
    "blind_until": np.int64,
    "mean": np.float32,
    "noise": np.float32,
    "drift": np.float32,
}
_BLOCKS = ("due_us", "since_us", "shot_next", "shot_count")
_ARRAYS = (*_FRAMES, *_BLOCKS)
_NUMBERS = ("clamped", "clock_us", "tick_us", "ticks")
_ALWAYS = ("reference", "last_log", "last_luminance")


@dataclass(eq=False)
class PlainState:
    """State of (h, w) pixels; an array is None where its term is off.

    The fixed pattern follows from the seed and is not in it. The sensor's clock is the sum of the
    ticks so far.
    """

    seed: int
    """the fixed pattern and all noise follow from it"""
    reference: F64
    """(h, w) log light at the last event, a multiple of 2^-43; NaN before a pixel's first light
    and while it is blind"""
    last_log: F32
    """(h, w) log light at the end of the last tick; NaN before a pixel's first light"""
    last_luminance: F32
    """(h, w) the last luminance that was one; -1 before a pixel's first light"""
    clamped: int = 0
    """pixels times ticks whose light was negative, NaN or Inf and was replaced by the last one"""
    clock_us: int = 0
    """sum of all ticks so far, us"""
    tick_us: int = 0
    """length of the last one, us"""
    ticks: int = 0
    """how many there were"""
    filtered: F32 | None = None
    """(h, w) log light after the photoreceptor's low pass"""
    followed: F32 | None = None
    """(h, w) after the source follower's"""
    blind_until: I64 | None = None
    """(h, w) by the sensor's clock, us, of pixels that are or were blind"""
    mean: F32 | None = None
    """(h, w) running mean of the luminance (model adaptive); NaN before a pixel's first light"""
    noise: F32 | None = None
    """(h, w) mean square from tick to tick"""
    drift: F32 | None = None
    """(h, w) mean of luminance less its running mean"""
    due_us: I64 | None = None
    """(blocks of 64 pixels,) by the sensor's clock: nothing happens before if light stands still"""
    since_us: I64 | None = None
    """(blocks,) by the sensor's clock: until then the leak is in the reference"""
    shot_next: I64 | None = None
    """(blocks,) when the next candidate for shot noise comes, by the sensor's clock, 2^-10 us"""
    shot_count: I64 | None = None
    """(blocks,) how many were drawn"""

    @classmethod
    def dark(
        cls,
        seed: int,
        sensor: SensorParameters,
        average: bool = False,
        terms: SensorTerms | None = None,
    ) -> PlainState:
        """Make the state of pixels that have seen no light yet.

        Args:
            seed: What fixed pattern and noise follow from.
            sensor: The sensor, resolved.
            average: Whether the running mean is on.
            terms: Those the pixels have; None: those the sensor needs.
        """
        terms = terms or SensorTerms.of(sensor, average)
        shape = (sensor.height, sensor.width)
        state = cls(
            seed=seed,
            reference=on_lines(np.full(shape, np.nan, np.float64)),
            last_log=on_lines(np.full(shape, np.nan, np.float32)),
            last_luminance=on_lines(np.full(shape, -1.0, np.float32)),
        )

        def add(on: object, zeros: Any, *names: str) -> None:
            for name in names if on else ():
                setattr(state, name, on_lines(zeros))

        zeros = np.zeros(shape, np.float32)
        filters = terms.low_pass or terms.follower or terms.high_pass
        blocks = np.zeros(-(-zeros.size // BLOCK), np.int64)
        add(terms.low_pass, zeros, "filtered")
        add(terms.follower, zeros, "followed")
        add(terms.refractory, np.zeros(shape, np.int64), "blind_until")
        add(terms.running_mean, zeros * np.float32(np.nan), "mean")
        add(terms.running_mean, zeros, "noise", "drift")
        lazy = terms.leaks or filters or terms.refractory or terms.running_mean
        add(lazy, blocks, "due_us", "since_us")
        add(terms.shot_noise, blocks, "shot_next", "shot_count")
        return state

    @property
    def clamps(self) -> int:
        """Everything that was replaced: light alone."""
        return self.clamped

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """The arrays that are there, by name: the live ones."""
        fields = vars(self)
        return {name: fields[name] for name in _ARRAYS if fields[name] is not None}

    def copy(self) -> PlainState:
        """A state of its own: stepping one does not touch the other."""
        copies: dict[str, Any] = {n: on_lines(array) for n, array in self.arrays().items()}
        return replace(self, **copies)

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that np.savez writes and `restore` takes back."""
        numbers = {name: np.array(getattr(self, name), np.int64) for name in _NUMBERS}
        arrays = {name: array.copy() for name, array in self.arrays().items()}
        return {**arrays, **numbers, "seed": np.array(self.seed % 2**64, np.uint64)}

    @classmethod
    def restore(cls, saved: Mapping[str, np.ndarray[Any, Any]]) -> PlainState:
        """The state that was saved. Raises EvsError where something of it is missing or unfit."""
        try:
            frames: dict[str, Any] = {
                name: on_lines(np.asarray(saved[name], dtype))
                for name, dtype in _FRAMES.items()
                if name in saved or name in _ALWAYS
            }
            blocks: dict[str, Any] = {
                name: on_lines(np.asarray(saved[name], np.int64))
                for name in _BLOCKS
                if name in saved
            }
            numbers: dict[str, Any] = {name: int(saved[name]) for name in ("seed", *_NUMBERS)}
        except KeyError as missing:
            raise EvsError(
                f"saved sensor state lacks {missing}; save it with PlainState.save"
            ) from None
        reference = frames["reference"]
        if len({array.shape for array in frames.values()}) != 1 or reference.ndim != 2:
            raise EvsError("saved sensor state has arrays of different shapes; save it again")
        if any(array.shape != (-(-reference.size // BLOCK),) for array in blocks.values()):
            raise EvsError("saved sensor state has arrays of different shapes; save it again")
        logs = [frames[name] for name in _LOGS if name in frames]
        if any(np.any(np.abs(log) > _LARGEST_LOG) for log in logs):
            raise EvsError(
                "saved sensor state is damaged: no log light is that large; save it again"
            )
        state = cls(**frames, **blocks, **numbers)
        if not state._is_possible():
            raise EvsError("saved sensor state is damaged: its times are invalid; save it again")
        return state

    def _is_possible(self) -> bool:
        """Whether its counters and times are such as a sensor can have."""
        if not (0 <= self.clock_us <= MAX_CLOCK_US and 0 <= self.ticks <= MAX_CLOCK_US):
            return False
        if not 0 <= self.tick_us <= MAX_TICK_US:
            return False
        times = [self.blind_until, self.due_us, self.since_us, self.shot_next, self.shot_count]
        if any(array is not None and np.any(np.abs(array) > _NEVER) for array in times):
            return False
        if np.any(np.isinf(self.last_luminance)) or not 0 <= self.clamped <= MAX_CLOCK_US * 2**11:
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
