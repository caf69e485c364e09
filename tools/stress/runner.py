"""Run extremes one after the other. One that breaks down is a finding, and the next still runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from evs.drivers.clock import monotonic_s
from evs.tools.stress.extreme import Extreme, Tried
from evs.tools.stress.groups import GROUPS, extremes_of


def run_extremes(
    groups: Iterable[str] = GROUPS,
    short: bool = False,
    on_done: Callable[[Tried], None] | None = None,
) -> list[Tried]:
    """Try every extreme of the groups, in the order of the table.

    In: short, the form for `evs doctor`; on_done, told of each as soon as it was tried. EvsError
    for an unknown group, before anything runs.
    """
    chosen = [extreme for group in groups for extreme in extremes_of(group)]
    tried = []
    for extreme in chosen:
        tried.append(try_extreme(extreme, short))
        if on_done is not None:
            on_done(tried[-1])
    return tried


def try_extreme(extreme: Extreme, short: bool = False) -> Tried:
    """Try one; whatever it raises is its error."""
    begin_s = monotonic_s()
    try:
        outcome, error = extreme.run(short), ""
    except Exception as reason:
        words = " ".join(str(reason).split())
        outcome, error = None, f"{type(reason).__name__}: {words}" if words else repr(reason)
    return Tried(extreme, outcome, error, monotonic_s() - begin_s)
