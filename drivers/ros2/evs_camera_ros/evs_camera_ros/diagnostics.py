"""What /diagnostics shows once a second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from evs.drivers.clock import monotonic_s
from evs_camera_ros.session import Session


@dataclass(frozen=True)
class _Counts:
    wall_s: float
    t_us: int
    events: int
    late_ticks: int
    slips: int
    dropped: int


class Diagnostics:
    """Compares a session with itself at the last report."""

    def __init__(
        self,
        session: Session,
        messages_dropped: Callable[[], tuple[int, int]],
        clock: Callable[[], float] = monotonic_s,
    ) -> None:
        """Start from now.

        Args:
            session: To report of.
            messages_dropped: Returns messages, and events in them, that no reader could be sent.
            clock: The wall clock, s.
        """
        self._session, self._messages_dropped, self._clock = session, messages_dropped, clock
        self._last = self._counts()

    def status(self, name: str) -> DiagnosticStatus:
        """Report the time since the last report."""
        last, now = self._last, self._counts()
        self._last = now
        seconds = now.wall_s - last.wall_s or 1e-9
        dropped, late = now.dropped - last.dropped, now.late_ticks - last.late_ticks
        if now.slips > last.slips:
            level, message = DiagnosticStatus.WARN, "too slow: simulated time slips behind"
        elif dropped:
            level, message = DiagnosticStatus.WARN, f"{dropped} events dropped"
        else:
            level, message = DiagnosticStatus.OK, "running"
        session = self._session
        values = {
            "events per second": f"{(now.events - last.events) / seconds:.0f}",
            "real-time factor": f"{(now.t_us - last.t_us) * 1e-6 / seconds:.3f}",
            "late ticks": str(late),
            "events dropped": str(dropped),
            "events dropped in total": str(now.dropped),
            "messages dropped in total": str(self._messages_dropped()[0]),
            "simulated time (s)": f"{now.t_us * 1e-6:.6f}",
        }
        return DiagnosticStatus(
            level=level,
            name=f"{name}: event camera",
            message=message,
            hardware_id=f"evs {session.camera.info.sensor}",
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    def _counts(self) -> _Counts:
        session = self._session
        return _Counts(
            self._clock(),
            session.world.t_us,
            session.events,
            session.late_ticks,
            session.slips,
            session.events_dropped + self._messages_dropped()[1],
        )
