"""The groups of stress cases, by name; the module of a group is imported on demand."""

from __future__ import annotations

from evs.emulator.base.registry import load
from evs.msgs import unknown
from evs.tools.stress.stress_case import StressCase

_CASES = {
    "light": "evs.tools.stress.light:CASES",
    "time": "evs.tools.stress.time:CASES",
    "motion": "evs.tools.stress.motion:CASES",
    "sensor": "evs.tools.stress.sensor:CASES",
    "network": "evs.tools.stress.network:CASES",
    "machine": "evs.tools.stress.machine:CASES",
}
"""group -> where its cases are; to add a case, write it in a module of its group"""

GROUPS = tuple(_CASES)
"""every group, in the order of the table"""


def cases_of(group: str) -> tuple[StressCase, ...]:
    """The cases of a group, in the order of the table.

    Raises:
        EvsError: there is no such group.
    """
    if group not in _CASES:
        raise unknown("group of extremes", group, GROUPS)
    cases: tuple[StressCase, ...] = load(_CASES[group])
    return cases
