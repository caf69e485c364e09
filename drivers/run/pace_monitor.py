"""Whether a run keeps up with the wall clock: updates for sinks, warnings for the user."""

from __future__ import annotations

from collections.abc import Callable

from evs.drivers.clock import Pacer
from evs.msgs import Pace
from evs.msgs.status import STATUS_PERIOD_US

_ADVICE = "try a smaller render.spp or sensor, or --pace free"
_FIRST_GAP_S = 10.0
"""Between the first two warnings; each gap is twice the one before."""

LATE_S = 0.1
"""A run that fell behind by more and caught up is warned of at its end."""


class PaceMonitor:
    """Watches the pacer of one run."""

    def __init__(self, pacer: Pacer, warn: Callable[[str], None]) -> None:
        self._pacer, self._warn = pacer, warn
        self._warned_s = self._warned_back_s = 0.0
        self._next_s = -1e300
        self._gap_s = _FIRST_GAP_S
        self._period = 0

    def update(self) -> None:
        """Warn after a tick was waited for: at once where time slips, then now and then."""
        pacer = self._pacer
        if pacer.went_back_s > self._warned_back_s:
            back_s = pacer.went_back_s - self._warned_back_s
            self._warn(
                f"this machine's clock went back by {back_s:.3g} s: "
                "the run does not wait for it to catch up, and packets continue on schedule"
            )
            self._warned_back_s = pacer.went_back_s
        if pacer.slipped_s <= self._warned_s:
            return
        now_s = pacer.now_s()
        if now_s < self._next_s:
            return
        self._warn_of_slip()
        self._next_s = now_s + self._gap_s
        self._gap_s *= 2

    def end(self) -> None:
        """Warn, at the end of the run, of what there was no warning of yet."""
        if self._pacer.slipped_s > self._warned_s:
            self._warn_of_slip()
        elif not self._pacer.slips and self._pacer.worst_late_s > LATE_S:
            self._warn(
                f"packets left up to {self._pacer.worst_late_s:.2g} s late and the run caught up "
                f"again: the pace is too much for this machine at times; {_ADVICE}"
            )

    def pace_update(self, t_us: int) -> Pace | None:
        """Return what statuses report, where simulated time t_us is the first of its period."""
        pacer, period = self._pacer, t_us // STATUS_PERIOD_US
        if pacer.speed == 0 or period == self._period:
            return None
        self._period = period
        return Pace(
            speed=pacer.speed,
            late_us=round(1e6 * pacer.late_s),
            worst_late_us=round(1e6 * pacer.worst_late_s),
            slipped_us=round(1e6 * pacer.slipped_s),
            slips=pacer.slips,
        )

    def _warn_of_slip(self) -> None:
        pacer = self._pacer
        self._warned_s = pacer.slipped_s
        self._warn(
            f"this machine cannot keep up: packets leave up to {pacer.worst_late_s:.2g} s late, "
            f"and simulated time has slipped {pacer.slipped_s:.3g} s behind the wall clock so far "
            f"(the run is slower, but skips no tick); {_ADVICE}"
        )
