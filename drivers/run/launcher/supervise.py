"""Runs a plan: starts subscribers first, watches all nodes, stops publishers first."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.run.launcher.guard import Guard
from evs.drivers.run.launcher.node import Node, command_of
from evs.drivers.run.launcher.plan import LaunchPlan
from evs.drivers.run.stop_signals import stop_signals
from evs.msgs import EvsError

INTERRUPTED = {"interrupted": 130, "terminated": 143}
"""why the launch stopped -> exit code, as shells count signals"""

_LOOK_S = 0.05
_AFTER_TERM_S = 2.0


class Launch:
    """All nodes of a plan. `run` returns when all have ended."""

    def __init__(
        self, plan: LaunchPlan, say: Callable[[str, str], None], tell: Callable[[str], None]
    ) -> None:
        """Make the nodes; none is started.

        Args:
            plan: Which nodes, in their order.
            say: Called with (node, line) for each line that a node prints.
            tell: Called with a line for each node that starts or ends.
        """
        self._guard = Guard()
        self.nodes = [Node(config, say, self._guard) for config in plan.nodes]
        self._tell = tell
        self._ending = ""

    def run(self) -> int:
        """Start all nodes, watch them, stop them. A second Ctrl-C kills those that are left.

        Returns:
            The worst exit code of a node; 130 after Ctrl-C if none is worse.

        Raises:
            EvsError: A node cannot be started; the others have been stopped.
        """
        failure: EvsError | None = None
        try:
            with stop_signals() as stopped:
                try:
                    self._start()
                    while not stopped and not self._ending and self._alive():
                        self._look()
                        sleep_s(_LOOK_S)
                except EvsError as error:
                    # those that run have files to close
                    failure = error
                    self._ending = "a node cannot be started"
                if stopped:
                    self._tell(f"{stopped[0]}: stopping every node, publishers first")
                elif self._ending:
                    self._tell(f"{self._ending}: stopping every node, publishers first")
                self._stop()
        finally:
            # whatever happened here, nothing of ours stays behind
            for node in self.nodes:
                if node.running:
                    node.signal(signal.SIGKILL)
            # report each end to the guard, or it would take this for ours
            _wait(self.nodes, _AFTER_TERM_S)
            self._guard.close()
        if failure is not None:
            raise failure
        code = INTERRUPTED.get(stopped[0], 0) if stopped else 0
        return max([code, *(node.code or 0 for node in self.nodes if node.failed)])

    def _start(self) -> None:
        for node in self.nodes:
            if node.config.delay_s > 0:
                node.again_s = monotonic_s() + node.config.delay_s
                continue
            node.start()
            self._tell(f"{node.config.name} started")

    def _alive(self) -> bool:
        return any(node.since_s or node.again_s is not None for node in self.nodes)

    def _look(self) -> None:
        """Handle the nodes that have ended since the last check."""
        for node in self.nodes:
            if node.again_s is not None and monotonic_s() >= node.again_s:
                node.start()
                again = " again" if node.restarts else ""
                self._tell(f"{node.config.name} started{again}")
            elif node.again_s is None and node.since_s and not node.running:
                node.since_s = 0.0
                self._ended(node)

    def _ended(self, node: Node) -> None:
        config = node.config
        self._tell(f"{config.name} {_said(node)}")
        if config.on_exit == "end":
            self._ending = self._ending or f"{config.name} has ended"
        elif config.on_exit == "restart" and node.failed:
            if node.restarts >= config.restarts:
                gave_up = f"{config.name} failed after {node.restarts} restarts"
                self._ending = self._ending or gave_up
                return
            node.restarts += 1
            node.again_s = monotonic_s() + config.restart_s
            count = f"{node.restarts} of {config.restarts}"
            self._tell(f"{config.name} starts again in {config.restart_s:g} s ({count})")

    def _stop(self) -> None:
        """Stop the last started first: publishers send their end while subscribers receive."""
        for node in self.nodes:
            # what was to start again does not
            node.again_s = None
        for node in reversed(self.nodes):
            _wait([node], node.alone_s)
            was_running = node.running
            for number, patience_s in (
                (signal.SIGINT, node.config.stop_s),
                (signal.SIGTERM, _AFTER_TERM_S),
                (signal.SIGKILL, _AFTER_TERM_S),
            ):
                if not node.running:
                    break
                node.signal(number)
                _wait([node], patience_s)
            if was_running or node.since_s:
                self._tell(f"{node.config.name} {_said(node)}")
                node.since_s = 0.0


def _wait(nodes: Sequence[Node], patience_s: float) -> None:
    deadline_s = monotonic_s() + patience_s
    while any(node.running for node in nodes) and monotonic_s() < deadline_s:
        sleep_s(_LOOK_S)


def _said(node: Node) -> str:
    """How it ended, in words."""
    code = node.code
    if code is None:
        return "does not end"
    if node.stop_requested and not node.failed:
        return "stopped"
    if not code:
        return "ended"
    if code > 128:
        try:
            return f"was killed by {signal.Signals(code - 128).name}"
        except ValueError:
            return f"failed with exit code {code}"
    return f"failed with exit code {code}"


def check_programs(plan: LaunchPlan) -> None:
    """Refuse what could not start, before anything does. Raises EvsError."""
    for config in plan.nodes:
        program = command_of(config.run)[0]
        # a path is one in the folder where it runs
        if shutil.which(str(Path(config.folder, program)) if "/" in program else program) is None:
            raise EvsError(
                f"node '{config.name}': there is no program '{config.run[0]}': check node.run"
            )
