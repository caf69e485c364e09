"""Two network namespaces and a cable between them, for tests of what a real link does.

No name is registered anywhere: a namespace lives as long as the `cat` that holds it, which ends
with its pipe. So nothing is left behind, however the test ends.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

_ROUGH = Path(__file__).with_name("rough_program.py")
_IMPATIENT = Path(__file__).with_name("impatient_program.py")
_HOLD = "echo ready; exec cat"
_CARD = "evs0"
"""the network card at each end"""


class NoLinkError(Exception):
    """This machine does not permit such a link; the message gives the reason in one line."""


class Side:
    """One end: a namespace of its own, with a loopback device and a network card."""

    def __init__(self, number: int, unshare: list[str], enter: list[str]) -> None:
        """Make the namespace.

        Args:
            number: The number of the end, 1 or 2: the last part of its addresses.
            unshare: The command that makes a namespace.
            enter: The command that enters it; {pid} stands for the process that holds it.

        Raises:
            NoLinkError: If the namespace cannot be made.
        """
        self.address = f"10.77.0.{number}"
        self.address6 = f"fd77::{number}"
        self.has_ipv6 = True
        self.python = [sys.executable, "-W", "error"]
        """how a Python program starts here"""
        self.programs: list[subprocess.Popen[Any]] = []
        pipe = subprocess.PIPE
        try:
            self._holder = subprocess.Popen(
                [*unshare, "sh", "-c", _HOLD], stdin=pipe, stdout=pipe, stderr=pipe, text=True
            )
        except OSError as reason:
            raise NoLinkError(f"{unshare[0]}: {reason.strerror}") from None
        assert self._holder.stdout is not None
        assert self._holder.stderr is not None
        if not self._holder.stdout.readline():
            said = self._holder.stderr.read().strip()
            self.close()
            raise NoLinkError(said or f"{unshare[0]} says nothing")
        self.pid = self._holder.pid
        self.enter = [word.format(pid=self.pid) for word in enter]
        self.ip("link", "set", "lo", "up")

    def run(self, command: Sequence[str], **more: Any) -> subprocess.Popen[Any]:
        """Start a program at this end; it is killed when the link is closed.

        Args:
            command: The program and its arguments.
            **more: Further arguments of Popen.
        """
        started = subprocess.Popen([*self.enter, *command], start_new_session=True, **more)
        self.programs.append(started)
        return started

    def ip(self, *words: str) -> None:
        """Configure this end, as `ip` does.

        Args:
            *words: The arguments of `ip`.

        Raises:
            NoLinkError: If `ip` fails.
        """
        done = subprocess.run([*self.enter, "ip", *words], capture_output=True, text=True)
        if done.returncode:
            raise NoLinkError(f"ip {' '.join(words)}: {done.stderr.strip()}")

    def bring_up(self) -> None:
        """Switch the network card on and give it its addresses."""
        self.ip("link", "set", _CARD, "up")
        self.ip("address", "replace", f"{self.address}/24", "dev", _CARD)
        try:
            # a card that is switched off forgets this address
            self.ip("address", "replace", f"{self.address6}/64", "dev", _CARD, "nodad")
        except NoLinkError:
            self.has_ipv6 = False

    def bring_down(self) -> None:
        """Switch the network card off."""
        self.ip("link", "set", _CARD, "down")

    def shape(self, rate: str) -> None:
        """Limit the rate at which data leave this end.

        Args:
            rate: The limit as `tc` writes it, for example "2mbit".

        Raises:
            NoLinkError: If `tc` fails.
        """
        words = ["qdisc", "add", "dev", _CARD, "root", "tbf", "rate", rate]
        words += ["burst", "32kbit", "latency", "5s"]
        done = subprocess.run([*self.enter, "tc", *words], capture_output=True, text=True)
        if done.returncode:
            raise NoLinkError(f"tc {' '.join(words)}: {done.stderr.strip()}")

    def close(self) -> None:
        """Kill the programs that run here, and release the namespace."""
        for program in self.programs:
            if program.poll() is None:
                os.killpg(program.pid, signal.SIGKILL)
            program.communicate()
        self._holder.communicate()


class Link:
    """A near end, a far end, and a cable that can be pulled. Close it, or use `with`.

    Root needs nothing else; other users need user namespaces, and are root inside them.

    Raises:
        NoLinkError: If this machine does not permit making namespaces.
    """

    def __init__(self) -> None:
        for program in ("ip", "unshare", "nsenter"):
            if shutil.which(program) is None:
                raise NoLinkError(f"{program} is missing (Debian: iproute2, util-linux)")
        self.sides: list[Side] = []
        reasons = []
        for make in (self._as_root, self._as_user):
            try:
                make()
                self._connect()
                return
            except NoLinkError as reason:
                reasons.append(str(reason))
                self.close()
        raise NoLinkError(f"no network namespaces here: {'; '.join(reasons)}")

    @property
    def near(self) -> Side:
        """The end at which tests put the camera."""
        return self.sides[0]

    @property
    def far(self) -> Side:
        """The end at which tests put the listeners."""
        return self.sides[1]

    def unplug(self, at: Side | None = None) -> None:
        """Switch one end's card off, the far one's by default; the other end loses its carrier."""
        (at or self.far).bring_down()

    def plug(self) -> None:
        """Undo `unplug`: switch both cards on."""
        for side in self.sides:
            side.bring_up()

    def give_up_after(self, patience_s: int) -> None:
        """Let programs that start later give up a cut connection sooner than evs does by itself.

        Args:
            patience_s: How long the other end may be silent, s; a multiple of 6.
        """
        for side in self.sides:
            side.python += [str(_IMPATIENT), str(patience_s)]

    def add_rough_line(self, delay_ms: float, jitter_ms: float, loss: float) -> tuple[str, str]:
        """Add a second, bad line between the ends.

        Args:
            delay_ms: The mean delay, each way.
            jitter_ms: The largest deviation from it, each way, so that packets overtake each other.
            loss: The share of packets that get lost, 0 ... 1.

        Returns:
            The addresses of the line at the near and at the far end.

        Raises:
            NoLinkError: If this machine does not permit it.
        """
        ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        addresses = []
        for number, (side, end) in enumerate(zip(self.sides, ends, strict=True), start=1):
            addresses.append(f"10.78.0.{number}")
            words = [str(end.fileno()), "evs1", f"{addresses[-1]}/24"]
            words += [str(one) for one in (delay_ms, jitter_ms, loss, number)]
            program = side.run(
                [sys.executable, str(_ROUGH), *words],
                pass_fds=[end.fileno()],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            end.close()
            if not program.stdout.readline():
                raise NoLinkError(program.stderr.read().strip().rpartition("\n")[2])
        return addresses[0], addresses[1]

    def close(self) -> None:
        """Kill the programs at both ends; the namespaces end with them. Safe to call twice."""
        for side in self.sides:
            side.close()
        self.sides = []

    def __enter__(self) -> Link:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _as_root(self) -> None:
        if os.geteuid():
            raise NoLinkError("not root")
        for number in (1, 2):
            self.sides.append(Side(number, ["unshare", "-n"], ["nsenter", "-t", "{pid}", "-n"]))

    def _as_user(self) -> None:
        """Make the ends as the root of a user namespace, which both share."""
        enter = ["nsenter", "-t", "{pid}", "-U", "-n", "--preserve-credentials"]
        self.sides.append(Side(1, ["unshare", "-r", "-n"], enter))
        self.sides.append(Side(2, [*self.near.enter, "unshare", "-n"], enter))

    def _connect(self) -> None:
        cable = ("link", "add", _CARD, "type", "veth", "peer", "name", _CARD)
        self.near.ip(*cable, "netns", str(self.far.pid))
        for side in self.sides:
            side.bring_up()
