"""From pixel to packet: what a chip's readout delays, orders and drops. Native.

Events come in from their pixels, and go out as the chip sends them.

core/sensor/readout.h has the way through it; tests/support/reference/readout.py is the slow
oracle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.small_files import read_small_text
from evs.emulator.sensor.parameters import ReadoutParameters, SensorParameters
from evs.msgs import EVENT_DTYPE, Events, EvsError, join_events

MAX_TIME_US = 2**52
"""Times beyond, of either sign, are refused: 142 years, so that ns fit into int64."""


def make_readout(sensor: SensorParameters, switches: Switches = UNFORCED) -> Readout | None:
    """The readout of a sensor; None where every event passes at its own time."""
    late = sensor.latency_us > 0 or sensor.latency_sigma_us > 0
    needed = late or not sensor.readout.is_ideal
    return Readout(sensor) if switches.decide("readout", needed) else None


class Readout:
    """What happens to events between pixel and packet: see ReadoutParameters."""

    def __init__(self, sensor: SensorParameters) -> None:
        """Raises EvsError for a region or a mask that is not on the sensor, and a bad mask file."""
        readout = sensor.readout
        self.native = _core.Readout(
            sensor.width,
            sensor.height,
            sensor.latency_us,
            sensor.latency_sigma_us,
            readout,
            draw_fates(readout, sensor.width, sensor.height),
        )

    def init(self, seed: int) -> ReadoutState:
        """The state before the first tick."""
        return ReadoutState.empty(seed)

    def step(
        self, events: Events, state: ReadoutState, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, ReadoutState]:
        """Read out the events of one tick.

        Args:
            events: (n,) EVENT_DTYPE, the pixels' events of that tick, sorted by t; of their 16
                bytes only t changes.
            state: What waits; it is consumed.
            t_begin_us: Where the tick begins, us.
            t_end_us: Where it ends, us.

        Returns:
            The events whose stamp lies in (t_begin_us, t_end_us], sorted by t; the state.

        Raises:
            EvsError: Events that are not sorted, in the tick and on the sensor, ticks that do not
                follow each other, a time over MAX_TIME_US, more events than memory.
        """
        self.check_tick(state, t_begin_us, t_end_us)
        flags = events.flags
        if not (events.dtype == EVENT_DTYPE and flags.c_contiguous and flags.aligned):
            events = join_events([events])
        try:
            raw, state.waiting, state.due_ns = self.native.step(
                events.view(np.uint8),
                state.clock,
                state.waiting,
                state.due_ns,
                t_begin_us,
                t_end_us,
            )
        except ValueError as reason:
            raise EvsError(f"readout of tick ({t_begin_us}, {t_end_us}] us: {reason}") from None
        except MemoryError:
            raise EvsError(
                f"the events up to {t_end_us} us do not fit in memory; raise the thresholds"
            ) from None
        state.t_us = np.array([t_end_us], np.int64)
        return raw.view(EVENT_DTYPE), state

    def check_tick(self, state: ReadoutState, t_begin_us: int, t_end_us: int) -> None:
        """Raises EvsError where a tick does not go forward from the last, or over MAX_TIME_US."""
        if t_end_us <= t_begin_us:
            raise EvsError(f"tick ({t_begin_us}, {t_end_us}] us does not go forward")
        if max(-t_begin_us, t_end_us) > MAX_TIME_US:
            raise EvsError(f"tick ({t_begin_us}, {t_end_us}] us is beyond {MAX_TIME_US} us")
        if state.t_us.size and state.t_us[0] != t_begin_us:
            raise EvsError(
                f"tick ({t_begin_us}, {t_end_us}] us does not follow the last, which ended at "
                f"{state.t_us[0]} us; call init of the readout again"
            )


CAUSES = ("roi", "mask", "busy", "scan", "erc", "fifo")
"""Why an event is dropped: outside the region of interest; masked; its pixel still waited for the
arbiter; or for the scan; event rate control; the link's FIFO was full."""

# places in `clock`; core/sensor/readout_state.h names all of them
SEED, DELAYED, FREE_NS, LAST_ROW, ACCESS_ROW, NEXT_SCAN = 6, 7, 11, 12, 13, 23
CLOCK_SIZE = 24

_ARRAYS = {"clock": np.int64, "waiting": np.uint8, "due_ns": np.int64, "t_us": np.int64}

I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]


@dataclass(eq=False)
class ReadoutState:
    """State of a readout. Ticks follow each other without a gap."""

    clock: I64
    """(24,) counts and moments of the arbiter, the scan, the rate control and the link; the first
    six count what was dropped, as CAUSES"""
    waiting: U8
    """(16 n,) the bytes of events that were not handed out yet: those still late in their pixels,
    those that wait for their row, those of a scan whose column is still to be read, those that wait
    for the link"""
    due_ns: I64
    """(n,) when each requests to be read, or leaves by the link"""
    t_us: I64
    """(1,) end of the last tick; (0,) before the first"""

    @classmethod
    def empty(cls, seed: int) -> ReadoutState:
        """The state before the first tick."""
        clock = np.zeros(CLOCK_SIZE, np.int64)
        clock[SEED] = np.array(seed % 2**64, np.uint64).view(np.int64)
        clock[FREE_NS] = clock[NEXT_SCAN] = np.iinfo(np.int64).min
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
        counts = clock[DELAYED : DELAYED + 4]
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


KEPT = 255
"""In a map of fates; any other value is the place of the cause in CAUSES."""

_ROI, _MASK = 0, 1

_MOST_BYTES = 1 << 25
"""Of a mask file: three million pixels."""


def draw_fates(readout: ReadoutParameters, width: int, height: int) -> U8 | None:
    """What becomes of each pixel's events, (height, width) uint8; None: all are kept.

    Raises EvsError for rectangles and pixels that are not on the sensor, and a bad mask file.
    """
    pixels = _masked(readout, width, height)
    if not readout.roi and not pixels:
        return None
    fates = np.full((height, width), _ROI if readout.roi else KEPT, np.uint8)
    numbers = iter(readout.roi)
    for x, y, wide, high in zip(numbers, numbers, numbers, numbers, strict=True):
        if wide < 1 or high < 1 or x < 0 or y < 0 or x + wide > width or y + high > height:
            raise EvsError(
                f"sensor.readout.roi {x} {y} {wide} {high} (x y width height) does not lie on the "
                f"{width} x {height} sensor"
            )
        fates[y : y + high, x : x + wide] = KEPT
    if pixels:
        x, y = np.array(pixels, np.int64).T
        fates[y, x] = np.where(fates[y, x] == KEPT, _MASK, fates[y, x])
    return fates


def _masked(readout: ReadoutParameters, width: int, height: int) -> list[tuple[int, int]]:
    """Every masked pixel (x, y)."""
    numbers = iter(readout.mask)
    pixels = list(zip(numbers, numbers, strict=True))
    places = ["sensor.readout.mask"] * len(pixels)
    if readout.mask_file:
        for place, pixel in _read(Path(readout.mask_file)):
            places.append(place)
            pixels.append(pixel)
    for place, (x, y) in zip(places, pixels, strict=True):
        if not (0 <= x < width and 0 <= y < height):
            raise EvsError(f"{place}: pixel {x} {y} is not on the {width} x {height} sensor")
    return pixels


def _read(path: Path) -> list[tuple[str, tuple[int, int]]]:
    """(where it stands, (x, y)) of each line of a mask file: "x y" or "x,y"; # begins a comment."""
    try:
        lines = read_small_text(path, _MOST_BYTES).splitlines()
    except FileNotFoundError:
        raise EvsError(f"no mask file '{path}' (sensor.readout.mask_file)") from None
    except UnicodeDecodeError:
        raise EvsError(f"mask file '{path}' is not text; give one x y per line") from None
    except OSError as reason:
        raise EvsError(f"cannot read mask file '{path}': {reason.strerror}") from None
    pixels = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) != 2 or not all(word.isdecimal() and len(word) < 6 for word in words):
            raise EvsError(f"mask file '{path}', line {number}: give x y of a pixel")
        pixels.append((f"mask file '{path}', line {number}", (int(words[0]), int(words[1]))))
    return pixels
