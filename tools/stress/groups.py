"""The groups of extremes, by name; a group's module is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Callable

from evs.msgs import unknown
from evs.tools.stress.extreme import Extreme


def _light() -> tuple[Extreme, ...]:
    from evs.tools.stress.light import EXTREMES

    return EXTREMES


def _time() -> tuple[Extreme, ...]:
    from evs.tools.stress.time import EXTREMES

    return EXTREMES


def _motion() -> tuple[Extreme, ...]:
    from evs.tools.stress.motion import EXTREMES

    return EXTREMES


def _sensor() -> tuple[Extreme, ...]:
    from evs.tools.stress.sensor import EXTREMES

    return EXTREMES


def _network() -> tuple[Extreme, ...]:
    from evs.tools.stress.network import EXTREMES

    return EXTREMES


def _machine() -> tuple[Extreme, ...]:
    from evs.tools.stress.machine import EXTREMES

    return EXTREMES


_LOADERS: dict[str, Callable[[], tuple[Extreme, ...]]] = {
    "light": _light,
    "time": _time,
    "motion": _motion,
    "sensor": _sensor,
    "network": _network,
    "machine": _machine,
}

GROUPS = tuple(_LOADERS)
"""every group, in the order of the table"""


def extremes_of(group: str) -> tuple[Extreme, ...]:
    """The extremes of a group, in the order of the table. EvsError for an unknown one."""
    if group not in _LOADERS:
        raise unknown("group of extremes", group, GROUPS)
    return _LOADERS[group]()
