"""The readout as a stage: events from their pixels in, events as the chip sends them out. Native.

core/sensor/readout.h has the way through it; tests/support/reference/readout.py is the slow
oracle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from evs.emulator import _core
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.sensor.readout.pixel_mask import draw_fates
from evs.emulator.sensor.readout.state import ReadoutState
from evs.msgs import EVENT_DTYPE, Events, EvsError, join_events

if TYPE_CHECKING:  # which has ReadoutParameters in it
    from evs.emulator.sensor.parameters import SensorParameters

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
        self._native = _core.Readout(
            width=sensor.width,
            height=sensor.height,
            latency_us=sensor.latency_us,
            latency_sigma_us=sensor.latency_sigma_us,
            order=readout.order,
            row_ns=readout.row_ns,
            column_ns=readout.column_ns,
            jitter_ns=readout.jitter_ns,
            scan_us=readout.scan_us,
            erc_target=readout.erc_target,
            erc_period_us=readout.erc_period_us,
            erc_drop=readout.erc_drop,
            link_rate=readout.link_rate,
            fifo=readout.fifo,
            stamp_sent=readout.stamp == "sent",
            fates=draw_fates(readout, sensor.width, sensor.height),
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
        if t_end_us <= t_begin_us:
            raise EvsError(f"tick ({t_begin_us}, {t_end_us}] us does not go forward")
        if max(-t_begin_us, t_end_us) > MAX_TIME_US:
            raise EvsError(f"tick ({t_begin_us}, {t_end_us}] us is beyond {MAX_TIME_US} us")
        if state.t_us.size and state.t_us[0] != t_begin_us:
            raise EvsError(
                f"tick ({t_begin_us}, {t_end_us}] us does not follow the last, which ended at "
                f"{state.t_us[0]} us; call init of the readout again"
            )
        flags = events.flags
        if not (events.dtype == EVENT_DTYPE and flags.c_contiguous and flags.aligned):
            events = join_events([events])
        try:
            raw, state.waiting, state.due_ns = self._native.step(
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
