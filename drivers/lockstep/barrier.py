"""The barrier of a step: complete once all controllers have requested the same move."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from evs.drivers.lockstep.clients import Client, Clients
from evs.msgs import EvsError
from evs.msgs.lockstep import F64, Reset, Restore, Step

Decision = Reset | Step | Restore
"""A request that moves the loop; all controllers have to agree on it."""


class Barrier:
    """Collects the decisions of all clients."""

    def __init__(self, clients: Clients) -> None:
        self.since_s: float | None = None
        """when the first of them came, s; None: there is none"""
        self.decisions: dict[bytes, Decision] = {}
        self._clients = clients

    @property
    def complete(self) -> bool:
        """Whether all have decided."""
        return len(self.decisions) >= max(len(self._clients.present), self._clients.controllers)

    @property
    def missing(self) -> list[bytes]:
        """The controllers that have joined and not decided."""
        return [one for one in self._clients.present if one not in self.decisions]

    def add(self, identity: bytes, decision: Decision, now_s: float) -> None:
        """Add one controller's decision. Raises EvsError if it is refused; then there is none."""
        client = self._clients.present[identity]
        # it may change its mind as long as the others have not all decided
        self.withdraw(identity)
        if isinstance(decision, Step):
            self.check(client, decision)
        for other, theirs in self.decisions.items():
            if not _agree(theirs, decision):
                name = self._clients.present[other].name
                raise EvsError(
                    f"'{name}' asks for {_describe(theirs)} and "
                    f"'{client.name}' for {_describe(decision)}: "
                    "all controllers have to ask for the same"
                )
        if not self.decisions:
            self.since_s = now_s
        self.decisions[identity] = decision

    def withdraw(self, identity: bytes) -> None:
        """Remove its decision."""
        self.decisions.pop(identity, None)
        if not self.decisions:
            self.since_s = None

    @staticmethod
    def check(client: Client, step: Step) -> None:
        """Raise EvsError unless a controller gives one control for each of its actuators."""
        count = len(client.actuators)
        if step.ctrl is not None and len(step.ctrl) != count:
            raise EvsError(
                f"ctrl has {len(step.ctrl)} numbers, but '{client.name}' has {count} "
                "actuators: give one number for each"
            )

    def clear(self) -> dict[bytes, Decision]:
        """Remove all decisions and return them."""
        decisions, self.decisions, self.since_s = self.decisions, {}, None
        return decisions


def joint_controls(
    decisions: dict[bytes, Decision], clients: dict[bytes, Client], last: Callable[[], F64]
) -> F64 | None:
    """Join all controllers' controls.

    Args:
        decisions: Of each identity.
        clients: By identity.
        last: Returns the vector that was decided last; a client without controls keeps its part.

    Returns:
        (nu,), or None where every client keeps its own.
    """
    given: list[tuple[Client, F64]] = []
    for identity, decision in decisions.items():
        if isinstance(decision, Step) and decision.ctrl is not None:
            given.append((clients[identity], decision.ctrl))
    if not given:
        return None
    if len(given) == 1 and given[0][0].has_all:
        return given[0][1]
    controls = np.array(last(), np.float64)
    for client, ctrl in given:
        controls[client.actuators] = ctrl
    return controls


def _agree(one: Decision, other: Decision) -> bool:
    if isinstance(one, Step) and isinstance(other, Step):
        return one.ticks == other.ticks
    if isinstance(one, Reset) and isinstance(other, Reset):
        return (one.seed, one.keyframe) == (other.seed, other.keyframe)
    return isinstance(one, Restore) and isinstance(other, Restore) and one.blob == other.blob


def _describe(decision: Decision) -> str:
    if isinstance(decision, Step):
        return f"a step of {decision.ticks} tick{'s' if decision.ticks > 1 else ''}"
    if isinstance(decision, Reset):
        keyframe = f", keyframe '{decision.keyframe}'" if decision.keyframe else ""
        return f"a reset (seed {decision.seed}{keyframe})"
    return f"a restore of {len(decision.blob)} bytes"
