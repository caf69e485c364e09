"""Where an episode begins: positions of joints, drawn from ranges, or what a function makes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from evs.emulator.world import MjData, MjModel
from evs.msgs import EvsError, unknown

Start = Mapping[str, tuple[float, float]] | Callable[[np.random.Generator, MjData], None]
"""name of a joint with one coordinate -> range of its position, drawn evenly; or a function that
puts the data somewhere."""

ONE_COORDINATE = (2, 3)
"""Slides and hinges, numbered as MuJoCo's mjtJoint."""


def check_start(model: MjModel, start: Start) -> Start:
    """`start` if every joint exists and every range is one; else EvsError."""
    if callable(start):
        return start
    known = {
        model.joint(index).name: int(model.jnt_type[index]) in ONE_COORDINATE
        for index in range(model.njnt)
    }
    for name, limits in start.items():
        if name not in known:
            raise unknown("joint", str(name), (one for one in known if one))
        if not known[name]:
            raise EvsError(f"joint '{name}' has more than one coordinate: give start= a function")
        if not _is_range(limits):
            raise EvsError(f"start['{name}'] is {limits!r}; give (low, high), such as (-0.1, 0.1)")
    return start


def begin(start: Start, random: np.random.Generator, data: MjData) -> None:
    """Put the data where an episode begins. Draws in the order of the names given."""
    if callable(start):
        start(random, data)
        return
    for name, (low, high) in start.items():
        data.joint(name).qpos[0] = random.uniform(low, high)


def _is_range(value: Any) -> bool:
    try:
        low, high = (float(end) for end in value)
    except (TypeError, ValueError):
        return False
    return math.isfinite(low) and math.isfinite(high) and low <= high
