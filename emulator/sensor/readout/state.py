"""ReadoutState: what a readout remembers from tick to tick. A value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs import EvsError

CAUSES = ("roi", "mask", "busy", "scan", "erc", "fifo")
"""Why an event is dropped: outside the region of interest; masked; its pixel still waited for the
arbiter; or for the scan; event rate control; the link's FIFO was full."""

# places in `clock`; core/sensor/readout_state.h names all of them
SEED, DELAYED, FREE_NS, LAST_ROW, ACCESS_ROW = 6, 7, 10, 11, 12
CLOCK_SIZE = 22

_ARRAYS = {"clock": np.int64, "waiting": np.uint8, "due_ns": np.int64, "t_us": np.int64}

I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]


@dataclass(eq=False)
class ReadoutState:
    """State of a readout. Ticks follow each other without a gap."""

    clock: I64
    """(22,) counts and moments of the arbiter, the rate control and the link; the first six count
    what was dropped, as CAUSES"""
    waiting: U8
    """(16 n,) the bytes of events that were not handed out yet: those still late in their pixels,
    those that wait for their row, those that wait for the link"""
    due_ns: I64
    """(n,) when each requests to be read, or leaves by the link"""
    t_us: I64
    """(1,) end of the last tick; (0,) before the first"""

    @classmethod
    def empty(cls, seed: int) -> ReadoutState:
        """The state before the first tick."""
        clock = np.zeros(CLOCK_SIZE, np.int64)
        clock[SEED] = np.array(seed % 2**64, np.uint64).view(np.int64)
        clock[FREE_NS] = np.iinfo(np.int64).min
        clock[LAST_ROW] = clock[ACCESS_ROW] = -1
        return cls(clock, np.zeros(0, np.uint8), np.zeros(0, np.int64), np.zeros(0, np.int64))

    @property
    def dropped(self) -> dict[str, int]:
        """Events dropped so far, by cause: each of CAUSES."""
        return {cause: int(count) for cause, count in zip(CAUSES, self.clock, strict=False)}

    @property
    def count_waiting(self) -> int:
        """Events that came and were neither handed out nor dropped yet."""
        return len(self.due_ns)

    def copy(self) -> ReadoutState:
        """A state of its own: stepping one does not touch the other."""
        return ReadoutState(*(getattr(self, name).copy() for name in _ARRAYS))

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that np.savez writes and `restore` takes back."""
        return {name: getattr(self, name).copy() for name in _ARRAYS}

    @classmethod
    def restore(cls, saved: Mapping[str, np.ndarray[Any, Any]]) -> ReadoutState:
        """The state that was saved. Raises EvsError where something of it is missing or unfit."""
        try:
            arrays = {
                name: np.array(saved[name], dtype, order="C") for name, dtype in _ARRAYS.items()
            }
        except KeyError as missing:
            raise EvsError(
                f"saved readout state lacks {missing}; save it with ReadoutState.save"
            ) from None
        clock, due_ns = arrays["clock"], arrays["due_ns"]
        counts = clock[DELAYED : DELAYED + 3]
        fits = (
            all(array.ndim == 1 for array in arrays.values())
            and clock.shape == (CLOCK_SIZE,)
            and arrays["waiting"].size == 16 * due_ns.size
            and arrays["t_us"].size <= 1
            and bool((counts >= 0).all())
            and counts.sum() == due_ns.size
        )
        if not fits:
            raise EvsError("saved readout state is damaged: its arrays do not fit; save it again")
        return cls(**arrays)

    def __eq__(self, other: object) -> bool:
        """Same bytes everywhere."""
        if not isinstance(other, ReadoutState):
            return NotImplemented
        return all(np.array_equal(getattr(self, k), getattr(other, k)) for k in _ARRAYS)

    __hash__ = None  # type: ignore[assignment]
