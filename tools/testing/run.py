"""Trace: the record of one episode of a controller. Run: all of them, with assertions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs import EvsError, unknown

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

SHOWN = 12
"""seeds that a message lists"""


@dataclass(frozen=True, eq=False)
class Trace:
    """The episode of one seed: n decisions, n + 1 moments, the start and after each decision."""

    seed: int
    t_us: I64
    """(n + 1,) simulated time of each moment, us"""
    sensors: dict[str, F64]
    """name of a <sensor> of the model -> (n + 1, its dimension)"""
    ctrl: F64
    """(n, nu) controls decided at the first n moments; NaN: the last ones are kept"""
    compute_s: F64
    """(n,) wall-clock time of each decision"""
    events: int
    """events that all cameras made"""
    done: str
    """why it ended early; "": it did not"""
    start: Any
    """the initial state, from ClosedLoop.save"""

    @property
    def t_s(self) -> F64:
        """(n + 1,) simulated time of each moment, s."""
        return np.asarray(self.t_us * 1e-6, np.float64)

    def values(self, name: str) -> F64:
        """(n + 1, dimension) values of a sensor.

        Raises:
            EvsError: there is no such sensor; it names those that exist.
        """
        if name not in self.sensors:
            raise unknown("sensor", name, self.sensors)
        return self.sensors[name]

    def value(self, name: str) -> F64:
        """(n + 1,) values of a sensor with one dimension.

        Raises:
            EvsError: there is no such sensor, or it has several dimensions.
        """
        values = self.values(name)
        if values.shape[1] != 1:
            raise EvsError(f"sensor '{name}' has {values.shape[1]} numbers: use values('{name}')")
        return values[:, 0]


@dataclass(frozen=True)
class Fault:
    """Where one seed breaks a claim."""

    trace: Trace
    says: str
    """what is wrong, and when"""
    size: float
    """how bad it is; the worst seed is reported in full"""


@dataclass(frozen=True, eq=False)
class Run:
    """One Trace for each seed. A claim that does not hold raises AssertionError.

    Claims about a time hold only for episodes that reach their end.
    """

    traces: tuple[Trace, ...]
    seconds: float
    """length of an episode that does not end early, simulated time"""
    keep: Callable[[Trace], tuple[str, ...]]
    """writes an episode to files; returns lines that say where, and how to run it again"""

    def never_ends(self) -> None:
        """No episode ends early, by a limit or by unstable physics."""
        __tracebackhide__ = True
        self._claim("an episode ends before its time", self._ended)

    def settles(
        self, sensor: str, within: float, after_s: float = 0.0, target: float = 0.0
    ) -> None:
        """From `after_s` on, the sensor stays within target +- within, inclusive."""
        __tracebackhide__ = True
        if not (within >= 0.0 and 0.0 <= after_s < self.seconds):
            raise EvsError(
                f"settles(within={within}, after_s={after_s}): give within of 0 or more, and "
                f"after_s of 0 ... {self.seconds:g}"
            )
        self._stays(f"{sensor} does not settle", sensor, target - within, target + within, after_s)

    def never_leaves(self, sensor: str, low: float, high: float) -> None:
        """The sensor always stays within low ... high, inclusive."""
        __tracebackhide__ = True
        if not low <= high:
            raise EvsError(f"never_leaves('{sensor}', {low}, {high}): give low <= high")
        self._stays(f"{sensor} leaves its range", sensor, low, high, 0.0)

    def latency_budget(self, median_us: float | None = None, p99_us: float | None = None) -> None:
        """The controller decides fast enough, by the wall clock, over all seeds together.

        Args:
            median_us: limit for the median of its decisions, us; None: no limit.
            p99_us: limit for the 99th percentile, us; None: no limit.
        """
        __tracebackhide__ = True
        if median_us is None and p99_us is None:
            raise EvsError("latency_budget(): give median_us=, p99_us= or both")
        took = {"median": (self.compute_us(0.5), median_us), "p99": (self.compute_us(0.99), p99_us)}
        over = [
            f"{name} {found:.0f} us, the budget is {budget:g} us"
            for name, (found, budget) in took.items()
            if budget is not None and not found <= budget
        ]
        if over:
            if not any(len(trace.compute_s) for trace in self.traces):
                raise AssertionError("no decision was made: every episode ended at its start")
            slow = max(self.traces, key=lambda trace: float(trace.compute_s.max(initial=0.0)))
            worst = int(slow.compute_s.argmax())
            count = sum(len(trace.compute_s) for trace in self.traces)
            raise AssertionError(
                f"the controller is too slow: {'; '.join(over)} (of {count} decisions)\n  the "
                f"slowest: {1e6 * slow.compute_s[worst]:.0f} us, seed {slow.seed}, at "
                f"t = {slow.t_s[worst]:.3f} s"
            )

    def compute_us(self, share: float) -> float:
        """Quantile `share` (0 ... 1) of the time of all decisions, us; NaN without decisions."""
        every = np.concatenate([trace.compute_s for trace in self.traces])
        if not len(every):
            return float("nan")
        return 1e6 * float(np.quantile(every, share, method="inverted_cdf"))

    def _stays(self, claim: str, sensor: str, low: float, high: float, after_s: float) -> None:
        __tracebackhide__ = True

        def fault(trace: Trace) -> Fault | None:
            return _outside(trace, sensor, low, high, after_s) or self._ended(trace)

        self._claim(claim, fault)

    def _ended(self, trace: Trace) -> Fault | None:
        """The fault if the episode ended early."""
        if not trace.done:
            return None
        end_s = float(trace.t_s[-1])
        says = f"ends at t = {end_s:.3f} s of {self.seconds:g} s: {trace.done}"
        return Fault(trace, says, self.seconds - end_s)

    def _claim(self, what: str, look: Callable[[Trace], Fault | None]) -> None:
        """Raise AssertionError with a report of the worst seed, if any seed breaks the claim."""
        __tracebackhide__ = True
        faults = [fault for trace in self.traces if (fault := look(trace)) is not None]
        if not faults:
            return
        worst = max(faults, key=lambda fault: fault.size)
        seeds = [str(fault.trace.seed) for fault in faults]
        listed = ", ".join(seeds[:SHOWN]) + (", ..." if len(seeds) > SHOWN else "")
        lines = [
            f"{what}: seed {worst.trace.seed} {worst.says}",
            f"{len(faults)} of {len(self.traces)} seeds fail: {listed}",
            *self.keep(worst.trace),
        ]
        raise AssertionError("\n  ".join(lines))

    def __str__(self) -> str:
        """One line: how many episodes, how long, how fast the controller was."""
        complete = sum(not trace.done for trace in self.traces)
        return (
            f"{complete} of {len(self.traces)} seeds last {self.seconds:g} s; a decision takes "
            f"{self.compute_us(0.5):.0f} us (median), {self.compute_us(0.99):.0f} us (p99)"
        )


def _outside(trace: Trace, sensor: str, low: float, high: float, after_s: float) -> Fault | None:
    """Where the sensor is outside low ... high from after_s on; a NaN is outside."""
    values, late = trace.values(sensor), trace.t_us >= round(after_s * 1e6)
    excess = np.where(late, _excess(values, low, high).max(axis=1), 0.0)
    wrong = np.flatnonzero(excess > 0.0)
    if not len(wrong):
        return None
    first, worst = int(wrong[0]), int(excess.argmax())
    says = (
        f"is at {_shown(values[worst])} at t = {trace.t_s[worst]:.3f} s, {excess[worst]:.4g} "
        f"outside {low:g} ... {high:g}; first outside at t = {trace.t_s[first]:.3f} s, "
        f"{len(wrong)} of {int(late.sum())} moments"
    )
    if trace.done:
        says += f"; it ended at t = {trace.t_s[-1]:.3f} s: {trace.done}"
    return Fault(trace, says, float(excess[worst]))


def _excess(values: F64, low: float, high: float) -> F64:
    """How far each value is outside; infinity for a NaN."""
    distance = np.maximum(np.maximum(low - values, values - high), 0.0)
    return np.where(np.isnan(values), np.inf, distance)


def _shown(values: F64) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
