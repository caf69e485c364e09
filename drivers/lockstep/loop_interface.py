"""What the server needs of a loop: all that `Loop` has, and what `Served` adds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy.typing as npt

from evs.msgs import Observation, StreamInfo
from evs.msgs.lockstep.common import F64


class ServedLoop(Protocol):
    """A closed loop, as a controller in process has it, and what is told to those who join."""

    def reset(
        self, seed: int | None = None, keyframe: str = "", state: bool = False
    ) -> Observation:
        """Begin an episode."""

    def step(self, ctrl: npt.ArrayLike | None = None, ticks: int = 1) -> Observation:
        """Decide, then go on."""

    def save(self, compress: bool = False) -> bytes:
        """All of it."""

    def restore(self, blob: bytes) -> Observation:
        """Back to where it was saved."""

    @property
    def actuators(self) -> Sequence[str]:
        """Names of all actuators, in the order of the controls."""

    @property
    def ctrl(self) -> F64:
        """(nu,) the last controls that were decided, whether they act yet or not."""

    @property
    def ctrl_range(self) -> F64:
        """(nu, 2) lowest and highest control of each actuator; infinite where there is no limit."""

    @property
    def streams(self) -> Sequence[StreamInfo]:
        """What is constant of each camera."""

    @property
    def tick_us(self) -> int:
        """Length of a tick, us."""

    @property
    def t_us(self) -> int:
        """Simulated time, us."""

    @property
    def done(self) -> str:
        """Why the episode is over; "": it goes on, or has not begun."""
