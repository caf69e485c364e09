"""The same server in real time: the clock moves physics, controls act when they arrive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from evs.drivers.clock import monotonic_s
from evs.drivers.lockstep.barrier import Decision, joint_controls
from evs.drivers.lockstep.clients import Client
from evs.drivers.lockstep.server import LockstepServer, answer_of
from evs.msgs import EvsError, Observation
from evs.msgs.lockstep import F64, Bye, Parts, Restore, Step

_MOST_AT_ONCE = 256
"""Requests handled between two ticks: a client that sends without end cannot stop the clock."""


@dataclass
class _View:
    """What a controller has not received yet, and its pending request."""

    answered_us: int
    """simulated time of its last answer"""
    answered_s: float
    """when it was answered last, to any request"""
    seen: list[Observation] = field(default_factory=list)
    """of each tick since"""
    step: Step | None = None
    """that waits for its answer"""


class RealtimeServer(LockstepServer):
    """Serves a loop whose ticks wait for the wall clock (in the loop) and for no controller.

    It stands still until the first reset, which every controller requests, and after an episode's
    end. A step's control acts in the next tick, and for good: the latest wins. Its answer comes
    once `ticks` ticks have passed since the last answer, at once if they have, with everything that
    was seen since. A controller without a request for `timeout_s` loses its seat; its last
    control goes on acting, as does that of one that leaves.
    """

    _views: dict[bytes, _View]
    _going: bool
    _ctrl: F64 | None
    """(nu,) what came since the last tick, as one; None: nothing"""

    def open(self) -> None:
        """As in lock-step."""
        self._views, self._going, self._ctrl = {}, False, None
        super().open()

    def poll(self) -> bool:
        """Handle what has come, then do one tick; or wait for a moment where nothing goes on."""
        if not self._going:
            return super().poll()
        if self._end is None:
            raise EvsError("this server is not open: call open() first")
        for _ in range(_MOST_AT_ONCE):
            if not self._end.is_waiting() or (came := self._end.receive()) is None:
                break
            self._take(*came)
        self._miss()
        if self._going:
            self._tick()
        return True

    def _decide(self, identity: bytes, decision: Decision) -> None:
        if not isinstance(decision, Step):
            super()._decide(identity, decision)
            return
        if not self._going and not self._view(identity).seen:
            over = f"the episode is over ({self._loop.done})" if self._loop.done else ""
            raise EvsError(f"{over or 'the loop has not begun'}: call reset")
        view, client = self._view(identity), self._clients.present[identity]
        self._barrier.check(client, decision)
        self.waits.add(monotonic_s() - view.answered_s)
        self.counts["steps"] += 1
        view.step = decision
        last, clients = self._ctrl, self._clients.present
        given = joint_controls(
            {identity: decision}, clients, lambda: self._loop.ctrl if last is None else last
        )
        self._ctrl = last if given is None else given
        self._answer_due(identity)

    def _move(self, decisions: dict[bytes, Decision], decision: Decision) -> None:
        super()._move(decisions, decision)
        self._views, self._ctrl = {}, None
        for identity in self._clients.present:
            self._view(identity)
        self._going = not self._loop.done

    def _break(self, line: str) -> None:
        """Report to all that wait for a reset why it does not come; time goes on."""
        super()._break(line)
        self._fault = ""

    @property
    def _next_moves(self) -> str:
        return "time goes on" if self._going else super()._next_moves

    def _give_up(self) -> None:
        """Only a reset waits: the loop itself goes on."""
        if not self._going or not self._clients.full:
            super()._give_up()
            return
        names = ", ".join(f"'{self._clients.present[one].name}'" for one in self._barrier.missing)
        what = (
            "restore"
            if any(isinstance(one, Restore) for one in self._barrier.decisions.values())
            else "reset"
        )
        self._break(f"{names} did not request a {what} within {self._timeout_s:g} s")

    def _lose(self, identities: Sequence[bytes], why: str) -> None:
        super()._lose(identities, why)
        for identity in identities:
            self._views.pop(identity, None)

    def _bye(self, client: Client, _: Bye) -> Parts:
        self._views.pop(client.peer[0], None)
        return super()._bye(client, _)

    def _answer(self, client: Client, parts: Parts) -> None:
        super()._answer(client, parts)
        if client.peer[0] in self._views:
            self._views[client.peer[0]].answered_s = monotonic_s()

    def _withdraw(self, identity: bytes) -> None:
        """Drop its request; its control acts all the same, since it has arrived."""
        super()._withdraw(identity)
        if identity in self._views:
            self._views[identity].step = None

    def _tick(self) -> None:
        clients, ctrl = self._clients.present, self._ctrl
        # who has just joined counts from before this tick
        views = [self._view(identity) for identity in clients]
        self._ctrl = None
        seen = self._loop.step(ctrl, 1)
        for view in views:
            view.seen.append(seen)
        self._going = not seen.done
        for identity in clients:
            self._answer_due(identity)

    def _answer_due(self, identity: bytes) -> None:
        """Answer its step, if it is due or no further tick comes."""
        view, client = self._views[identity], self._clients.present[identity]
        if view.step is None or not view.seen:
            return
        last = view.seen[-1]
        passed_us = last.t_us - view.answered_us
        if passed_us < view.step.ticks * self._loop.tick_us and not last.done:
            return
        answer = answer_of(client, _together(view.seen))
        self._views[identity] = _View(last.t_us, monotonic_s())
        self._answer(client, answer)

    def _view(self, identity: bytes) -> _View:
        if identity not in self._views:
            self._views[identity] = _View(self._loop.t_us, monotonic_s())
        return self._views[identity]

    def _miss(self) -> None:
        """Remove controllers that are gone, or have sent no request for too long."""
        assert self._end is not None
        for identity in self._end.gone():
            self._lose([identity], "has gone (its connection closed)")
        now_s = monotonic_s()
        for identity, view in list(self._views.items()):
            waits = view.step is not None or identity in self._barrier.decisions
            if not waits and now_s - view.answered_s > self._timeout_s:
                self._lose([identity], f"made no request for {self._timeout_s:g} s")
        since_s = self._barrier.since_s
        if since_s is not None and now_s - since_s > self._timeout_s:
            self._give_up()


def _together(seen: list[Observation]) -> Observation:
    """Join what several ticks brought, at the time of the last."""
    if len(seen) == 1:
        return seen[0]
    joined: dict[str, Any] = {
        key: tuple(one for each in seen for one in getattr(each, key))
        for key in ("packets", "frames", "imu")
    }
    return replace(seen[-1], **joined)
