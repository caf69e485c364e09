"""Pushes: forces from outside, at exact ticks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from evs.emulator import ClosedLoop
from evs.msgs import EventPacket, EvsError, unknown

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Push:
    """A force on a body for some time."""

    body: str
    """name of the body; the force acts at its centre of mass"""
    at_s: float
    """when it begins, simulated time"""
    force_n: Vector = (0.0, 0.0, 0.0)
    """in the world's axes, N"""
    torque_nm: Vector = (0.0, 0.0, 0.0)
    """in the world's axes, N m"""
    for_s: float = 0.01
    """how long it lasts; rounded to whole ticks, at least one"""


class Pushes:
    """All pushes of an episode, applied to a loop at the beginning of each of its ticks."""

    def __init__(self, loop: ClosedLoop, pushes: Sequence[Push]) -> None:
        """Prepare the pushes of an episode.

        Args:
            loop: to which they are applied.
            pushes: the pushes.

        Raises:
            EvsError: a body does not exist, or a number is not finite.
        """
        model = loop.world.model
        bodies = [model.body(index).name for index in range(model.nbody)]
        self._loop, self._when = loop, []
        self._before = loop.on_tick
        for push in pushes:
            if not isinstance(push, Push):
                raise EvsError(f"pushes holds {push!r}; give evs.tools.testing.Push(...)")
            if push.body not in bodies:
                raise unknown("body", str(push.body), (name for name in bodies if name))
            values = (push.at_s, push.for_s, *push.force_n, *push.torque_nm)
            if len(values) != 8 or not all(map(math.isfinite, values)) or push.for_s < 0:
                raise EvsError(f"{push} is not finite or ends before it begins: mend it")
            first = round(push.at_s * 1e6 / loop.tick_us)
            ticks = max(1, round(push.for_s * 1e6 / loop.tick_us))
            wrench = np.array([*push.force_n, *push.torque_nm], np.float64)
            self._when.append((first, first + ticks, bodies.index(push.body), wrench))

    def begin(self) -> None:
        """Begin an episode: from now on, the forces follow the clock of the loop."""
        if not self._when:
            return
        before = self._before = self._loop.on_tick

        def on_tick(packets: tuple[EventPacket, ...]) -> None:
            if before is not None:
                before(packets)
            self._act()

        self._loop.on_tick = on_tick
        self._act()

    def end(self) -> None:
        """End the episode: restore the loop's callback and remove all forces."""
        if self._when:
            self._loop.on_tick = self._before
            self._loop.world.data.xfrc_applied[:] = 0.0

    def _act(self) -> None:
        """Set the forces of the tick that begins now."""
        world = self._loop.world
        world.data.xfrc_applied[:] = 0.0
        for first, end, body, wrench in self._when:
            if first <= world.tick < end:
                world.data.xfrc_applied[body] += wrench


def plain_pushes(pushes: Sequence[Push]) -> list[dict[str, Any]]:
    """The pushes as JSON values."""
    return [asdict(push) for push in pushes]


def pushes_of(plain: Sequence[dict[str, Any]]) -> tuple[Push, ...]:
    """The pushes from what `plain_pushes` returned."""
    return tuple(
        Push(
            body=str(one["body"]),
            at_s=float(one["at_s"]),
            force_n=_vector(one["force_n"]),
            torque_nm=_vector(one["torque_nm"]),
            for_s=float(one["for_s"]),
        )
        for one in plain
    )


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
