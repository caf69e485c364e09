"""Sinks beside a closed loop: live ones go on over resets, each stretch of time has its file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from evs.drivers.pipeline.config import SinkConfig, make_sink
from evs.drivers.pipeline.outlets import Beside, Outlets
from evs.drivers.sink import SinkStoppedError
from evs.emulator.stages import Meter
from evs.msgs import EventPacket, Pace, StreamInfo


def segment_path(file: str, number: int) -> str:
    """run.aedat4, run-episode-002.aedat4, ...: where segment `number` (from 1) is recorded."""
    path = Path(file)
    return (
        file
        if number == 1
        else str(path.with_name(f"{path.stem}-episode-{number:03d}{path.suffix}"))
    )


class Segments:
    """All sinks of a run whose time may jump.

    A file holds time that runs forward, so each reset and each restore begins another one. A sink
    that stops (its disk is full) is warned of and left out: the controllers go on.
    """

    def __init__(
        self, tables: Sequence[SinkConfig], meter: Meter, warn: Callable[[str], None]
    ) -> None:
        self._files = [table for table in tables if table.file or table.rrd]
        self._meter, self._warn = meter, warn
        live = [make_sink(table) for table in tables if table not in self._files]
        self._live = Outlets(live, meter, warn)
        self._kept: Outlets | None = None
        self._number = 0
        self._written = False
        self._infos: Sequence[StreamInfo] = ()
        self._said: list[dict[str, Any]] = []
        self.files: list[str] = []
        """every file that was begun, in that order"""

    def open(self, infos: Sequence[StreamInfo]) -> None:
        """Open them all, before anybody may connect."""
        self._live.open(infos)
        self.begin(infos)

    def begin(self, infos: Sequence[StreamInfo]) -> None:
        """Time has jumped. What was recorded until now is complete."""
        if self._kept is not None and not self._written and list(infos) == list(self._infos):
            return
        self._close_files()
        self._infos = list(infos)
        if self._written or not self._number:
            self._number += 1
        self._written = False
        tables = [self._of_segment(table) for table in self._files]
        self.files += [name for table in tables if (name := table.file or table.rrd or "")]
        self._kept = Outlets([make_sink(table) for table in tables], self._meter, self._warn)
        self._kept.open(infos)

    def write(
        self,
        cameras: Sequence[Beside],
        packets: Sequence[EventPacket],
        t_us: int,
        pace: Pace | None = None,
    ) -> None:
        """What a tick brought, to all. In: pace, where there is news of it."""
        self._written = True
        for outlets in (self._live, self._kept):
            if outlets is None:
                continue
            try:
                if pace is not None:
                    outlets.write_pace(pace)
                outlets.write_beside(cameras, t_us)
                outlets.write(packets)
            except SinkStoppedError as error:
                # it was the last of its kind, of which the others are told by a warning
                self._warn(str(error))

    @property
    def stop_wanted(self) -> bool:
        """Whether somebody asked a sink for the end of the run."""
        return self._live.stop_wanted

    @property
    def said(self) -> list[dict[str, Any]]:
        """What each sink said when it was closed: the live ones, then file by file."""
        return [*self._live.said, *self._said]

    def close(self) -> BaseException | None:
        """Close every sink that was opened; the first error, if any."""
        first = self._close(self._kept)
        return first or self._live.close()

    def _close_files(self) -> None:
        error = self._close(self._kept)
        if error is not None:
            raise error

    def _close(self, outlets: Outlets | None) -> BaseException | None:
        if outlets is None:
            return None
        self._kept = None
        error = outlets.close()
        # a file that was begun and not written is begun again under its name
        if self._written or error is not None:
            self._said += outlets.said
        else:
            del self.files[len(self.files) - len(self._files) :]
        return error

    def _of_segment(self, table: SinkConfig) -> SinkConfig:
        if table.file:
            return replace(table, file=segment_path(table.file, self._number))
        return replace(table, rrd=segment_path(table.rrd or "", self._number))
