"""PlainState: what a plain pixel array remembers from tick to tick. A value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.scene import F32, F64
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import EvsError

MAX_TICK_US = 2**30 - 1
"""Longest tick, about 18 minutes."""

_LARGEST_LOG = 128.0
"""The logarithm of no float32 is larger, of either sign."""

_ARRAYS = {"reference": np.float64, "last_log": np.float32, "last_luminance": np.float32}


@dataclass(eq=False)
class PlainState:
    """State of (h, w) plain pixels. Thresholds follow from the seed and are not in it."""

    seed: int
    """thresholds are drawn from it"""
    reference: F64
    """(h, w) log light at the last event, a multiple of 2^-32; NaN before a pixel's first light"""
    last_log: F32
    """(h, w) log light at the end of the last tick; NaN before a pixel's first light"""
    last_luminance: F32
    """(h, w) the luminance that gave last_log; -1 before a pixel's first light"""
    clamped: int = 0
    """pixels times ticks whose light was negative, NaN or Inf and was replaced by the last one"""

    @classmethod
    def dark(cls, seed: int, height: int, width: int) -> PlainState:
        """The state of pixels that have seen no light yet."""
        return cls(
            seed=seed,
            reference=np.full((height, width), np.nan, np.float64),
            last_log=np.full((height, width), np.nan, np.float32),
            last_luminance=np.full((height, width), -1.0, np.float32),
        )

    def copy(self) -> PlainState:
        """A state of its own: stepping one does not touch the other."""
        return PlainState(
            self.seed,
            self.reference.copy(),
            self.last_log.copy(),
            self.last_luminance.copy(),
            self.clamped,
        )

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that np.savez writes and `restore` takes back."""
        counters = {
            "seed": np.array(self.seed % 2**64, np.uint64),
            "clamped": np.array(self.clamped, np.int64),
        }
        return {name: getattr(self, name).copy() for name in _ARRAYS} | counters

    @classmethod
    def restore(cls, saved: Mapping[str, np.ndarray[Any, Any]]) -> PlainState:
        """The state that was saved. Raises EvsError where something of it is missing or unfit."""
        try:
            arrays = {
                name: np.array(saved[name], dtype, order="C") for name, dtype in _ARRAYS.items()
            }
            seed, clamped = int(saved["seed"]), int(saved["clamped"])
        except KeyError as missing:
            raise EvsError(
                f"saved sensor state lacks {missing}; save it with PlainState.save"
            ) from None
        if len({array.shape for array in arrays.values()}) != 1 or arrays["reference"].ndim != 2:
            raise EvsError("saved sensor state has arrays of different shapes; save it again")
        if np.any(np.abs(arrays["reference"]) > _LARGEST_LOG):
            raise EvsError(
                "saved sensor state is damaged: no log light is that large; save it again"
            )
        return cls(seed=seed, clamped=clamped, **arrays)

    def __eq__(self, other: object) -> bool:
        """Same bits everywhere; a NaN equals itself."""
        if not isinstance(other, PlainState):
            return NotImplemented
        if (self.seed - other.seed) % 2**64 or self.clamped != other.clamped:
            return False
        pairs = [(getattr(self, name), getattr(other, name)) for name in _ARRAYS]
        return all(a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in pairs)

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
            f"sensor state is {state.reference.shape}, the sensor is {shape}; init it anew"
        )
    if t_end_us <= t_begin_us:
        raise EvsError(f"tick ({t_begin_us}, {t_end_us}] us does not go forward")
    if t_end_us - t_begin_us > MAX_TICK_US:
        raise EvsError(
            f"tick of {t_end_us - t_begin_us} us is over {MAX_TICK_US} us; use shorter ones"
        )
