"""FoxgloveSink: a run for Foxglove, over its WebSocket protocol or as an MCAP file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evs.drivers.bus.address import plain_tcp
from evs.drivers.viewer.picture_sink import PictureSink
from evs.drivers.viewer.time_windows import PERIOD_US
from evs.msgs import EvsError, StreamInfo
from evs.msgs.codecs import PayloadWriter

if TYPE_CHECKING:
    from evs.drivers.viewer.foxglove_drawing import FoxgloveDrawing

SUFFIX = ".mcap"


class FoxgloveSink(PictureSink):
    """A PictureSink that serves Foxglove's clients, or writes an MCAP file (extra `foxglove`).

    A client that is too slow loses the oldest messages, and the camera never waits; a file loses
    nothing. Nothing is computed for a topic without subscribers.
    """

    def __init__(
        self,
        *,
        address: str = "",
        mcap: str | Path = "",
        period_us: int = PERIOD_US,
        encoding: str = "evt3",
        queue: int = 1000,
        wait_for: int = 0,
        wait_s: float = 10.0,
        insecure: bool = False,
    ) -> None:
        """Make a sink that is not open yet.

        Args:
            address: tcp://HOST:PORT to serve; or give mcap.
            mcap: File to write, ending in .mcap; replaced at open.
            period_us: Simulated time from one picture, rate and event message to the next, us.
            encoding: Of the events, a key of PAYLOADS.
            queue: Messages that may wait for the thread that sends them, and for each client.
            wait_for: Clients that `open` waits for.
            wait_s: Time to wait, s.
            insecure: Whether other machines may connect.

        Raises:
            EvsError: A value that cannot be, or the extra is not installed.
        """
        from evs.drivers.viewer.foxglove_drawing import need_foxglove

        super().__init__(period_us)
        for name, value, least in (("queue", queue, 1), ("wait_for", wait_for, 0)):
            if value < least:
                raise EvsError(f"{name} is {value}: give {least} or more")
        if not wait_s >= 0:
            raise EvsError(f"wait_s is {wait_s:g}: give 0 or more")
        if bool(address) == bool(mcap):
            raise EvsError(
                "a foxglove sink has one destination: give address=tcp://127.0.0.1:8765 to serve "
                "clients, or mcap=run.mcap for a file; for both, make two sinks"
            )
        self._path = Path(mcap) if mcap else None
        if self._path is not None:
            if self._path.suffix != SUFFIX:
                raise EvsError(f"'{self._path}' does not end in {SUFFIX}, as Foxglove's files do")
            if wait_for or insecure:
                raise EvsError("wait_for and insecure belong to an address: leave them out")
        else:
            self._host, self._port = plain_tcp(address, insecure, "Foxglove")
        PayloadWriter(encoding)
        need_foxglove()
        self._address, self._encoding, self._queue = address, encoding, queue
        self._wait_for, self._wait_s = wait_for, wait_s
        self._panels: FoxgloveDrawing | None = None

    @property
    def port(self) -> int:
        """The TCP port of the server, once open; 0 of a file."""
        return 0 if self._panels is None else self._panels.port

    def close(self) -> dict[str, Any]:
        """Send what is left, then end the file or the server. Safe to call twice."""
        where = {"path": str(self._path)} if self._path else {"address": self._address}
        found = {"type": "foxglove", **where, **super().close()}
        if self._panels is not None:
            found |= self._panels.counts
            if self._path is None:
                found["clients"] = self._panels.clients
                found["overflow_notices"] = self._panels.overflow_notices
        return found

    def _begin(self, streams: Sequence[StreamInfo]) -> FoxgloveDrawing:
        from evs.drivers.viewer.foxglove_drawing import FoxgloveDrawing

        self._panels = panels = FoxgloveDrawing(
            self._queue, self._encoding, self._period_us, lossless=self._path is not None
        )
        try:
            if self._path is not None:
                panels.to_file(self._path, streams)
            else:
                panels.to_clients(self._host, self._port, streams)
                self._await_clients(panels)
        except BaseException:
            panels.release()
            raise
        return panels

    def _await_clients(self, panels: FoxgloveDrawing) -> None:
        if not panels.wait_for_clients(self._wait_for, self._wait_s):
            raise EvsError(
                f"{panels.clients} of {self._wait_for} Foxglove clients subscribed on "
                f"{self._address} within {self._wait_s:g} s: open ws://{self._host}:{panels.port} "
                "while this waits, or give wait_s more"
            )

    def _stopped(self, failure: str) -> str:
        return (
            f"writing {self._path} stopped: {failure}; the file holds what came before, free some "
            "space and run again"
        )
