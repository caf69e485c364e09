"""The sinks of a closed loop: live ones go on over resets, each segment of time has its file."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evs.drivers.files.paths import FORCE, check_new, free_number, numbered_path
from evs.drivers.run.config import make_sink
from evs.drivers.run.sensor_control import SensorControl
from evs.drivers.run.sink_set import AuxiliaryStreams, SinkSet
from evs.drivers.sink import SinkStoppedError
from evs.drivers.sink_config import FileSink, SinkConfig
from evs.emulator.base.protocols import Meter
from evs.msgs import EventPacket, EvsError, Pace, StreamInfo

_NO_NAME = re.compile(r"[^\w.-]")
"""what names of cameras have and names of files should not"""


def segment_path(file: str, number: int) -> str:
    """Return where segment `number` (from 1) is recorded: run.aedat4, run-episode-002.aedat4 ..."""
    path = Path(file)
    return (
        file
        if number == 1
        else str(path.with_name(f"{path.stem}-episode-{number:03d}{path.suffix}"))
    )


def camera_path(file: str, camera: str) -> str:
    """Return where one of several cameras is recorded: run-left.aedat4."""
    path = Path(file)
    return str(path.with_name(f"{path.stem}-{_NO_NAME.sub('_', camera)}{path.suffix}"))


@dataclass(frozen=True)
class _Share:
    """Recorders, with the cameras that they record."""

    sinks: SinkSet
    infos: tuple[StreamInfo, ...]

    def takes(self, camera: str) -> bool:
        """Whether that one is."""
        return any(info.camera == camera for info in self.infos)


class Segments:
    """All sinks of a run whose time may jump.

    A file holds one camera and time that runs forward: each of several cameras has its own, and
    each reset and each restore begins another. A sink that stops (its disk is full) is warned of
    and left out: the controllers go on.
    """

    def __init__(
        self,
        tables: Sequence[SinkConfig],
        meter: Meter,
        warn: Callable[[str], None],
        beside: bool = False,
        sensors: SensorControl | None = None,
    ) -> None:
        """Make the sinks; `open` opens them.

        Args:
            tables: Of every sink.
            meter: Every sink gets it.
            warn: Gets one line for each sink that stops.
            beside: See `PipelineConfig`.
            sensors: See `SinkSet`, for sinks that continue across resets.
        """
        self._beside, self._place = beside, 0
        self._files = [table for table in tables if table.path]
        self._meter, self._warn = meter, warn
        live = [make_sink(table) for table in tables if table not in self._files]
        self._live = SinkSet(live, meter, warn, sensors)
        self._kept: list[_Share] | None = None
        self._number, self._begun = 0, 0
        self._written = False
        self._infos: Sequence[StreamInfo] = ()
        self._reports: list[dict[str, Any]] = []
        self.failure: EvsError | None = None
        """of a sink: the run has to end"""
        self.files: list[str] = []
        """every file that was begun, in that order"""

    def open(self, infos: Sequence[StreamInfo]) -> None:
        """Open them all, before anybody may connect."""
        self._settle(infos)
        self._live.open(infos)
        self.begin(infos)

    def begin(self, infos: Sequence[StreamInfo]) -> None:
        """Begin a segment: time has jumped, and what was recorded until now is complete."""
        if self._kept is not None and not self._written and list(infos) == list(self._infos):
            return
        self._close_files()
        self._infos = list(infos)
        if self._written or not self._number:
            self._number += 1
        self._written = False
        shares = [share for table in self._files for share in self._shares(table)]
        names = [name for name, _ in shares]
        if len(set(names)) < len(names):
            several = ", ".join(names)
            raise EvsError(f"two of {several} are one file: give each sink a name of its own")
        self.files += names
        self._kept, self._begun = [], len(names)
        for _, share in shares:
            self._kept.append(share)
            share.sinks.open(share.infos)

    def jump(self, infos: Sequence[StreamInfo]) -> None:
        """As `begin`, while controllers wait; an error is kept in `failure`."""
        try:
            self.begin(infos)
        except EvsError as error:
            self.failure = error

    def write_tick(
        self,
        cameras: Sequence[AuxiliaryStreams],
        packets: Sequence[EventPacket],
        t_us: int,
        pace: Pace | None = None,
    ) -> None:
        """Write everything of a tick to all sinks; an error is kept in `failure`."""
        if self.failure is not None:
            return
        try:
            self._write_tick(cameras, packets, t_us, pace)
        except EvsError as error:
            self.failure = error

    def _write_tick(
        self,
        cameras: Sequence[AuxiliaryStreams],
        packets: Sequence[EventPacket],
        t_us: int,
        pace: Pace | None,
    ) -> None:
        self._written = True
        self._give(self._live, cameras, packets, t_us, pace)
        for share in self._kept or ():
            mine = [camera for camera in cameras if share.takes(camera.info.camera)]
            sent = [packet for packet in packets if share.takes(packet.camera)]
            self._give(share.sinks, mine, sent, t_us, pace)

    @property
    def stop_wanted(self) -> bool:
        """Whether a client of a sink requested the end of the run."""
        return self._live.stop_wanted

    @property
    def reports(self) -> list[dict[str, Any]]:
        """What each sink reported when it was closed: the live ones, then file by file."""
        return [*self._live.reports, *self._reports]

    def close(self) -> BaseException | None:
        """Close every sink that was opened; the first error, if any."""
        first = self._close()
        return first or self._live.close()

    def _give(
        self,
        sinks: SinkSet,
        cameras: Sequence[AuxiliaryStreams],
        packets: Sequence[EventPacket],
        t_us: int,
        pace: Pace | None,
    ) -> None:
        try:
            sinks.write_tick(cameras, packets, t_us, pace)
        except SinkStoppedError as error:
            # it was the last sink of this set; the run goes on with a warning
            self._warn(str(error))

    def _close_files(self) -> None:
        error = self._close()
        if error is not None:
            raise error

    def _close(self) -> BaseException | None:
        """Close what is recorded now; the first error, if any."""
        if self._kept is None:
            return None
        shares, self._kept = self._kept, None
        errors = [share.sinks.close() for share in shares]
        error = next((one for one in errors if one is not None), None)
        # a file that was begun and not written is begun again under its name
        if self._written or error is not None:
            self._reports += [one for share in shares for one in share.sinks.reports]
        else:
            del self.files[len(self.files) - self._begun :]
        return error

    def _settle(self, infos: Sequence[StreamInfo]) -> None:
        """Choose names beside earlier recordings, or refuse to replace them, before it begins."""
        kept = [table for table in self._files if self._beside or not table.overwrite]
        names = [name for table in kept for name in self._names(table, infos, 1)]
        if self._beside:
            self._place = free_number(names)
            return
        check_new(names, FORCE)
        for name in map(Path, names):
            form = re.compile(rf"{re.escape(name.stem)}-episode-\d{{3,}}{re.escape(name.suffix)}")
            if name.parent.is_dir():
                later = sorted(one for one in name.parent.iterdir() if form.fullmatch(one.name))
                check_new(later, FORCE)

    def _shares(self, table: SinkConfig) -> list[tuple[str, _Share]]:
        """Each file of a table in this segment: its name, and what records it."""
        infos = tuple(self._infos)
        names = self._names(table, infos, self._number)
        if not isinstance(table, FileSink):
            return [(names[0], self._share(table.at(names[0]), infos))]
        return [
            (name, self._share(table.at(name), (info,)))
            for name, info in zip(names, infos, strict=True)
        ]

    def _names(self, table: SinkConfig, infos: Sequence[StreamInfo], number: int) -> list[str]:
        """Of its files in segment `number`: one a camera, of rerun and foxglove one for all."""
        file = table.path
        several = isinstance(table, FileSink) and len(infos) > 1
        files = [camera_path(file, info.camera) for info in infos] if several else [file]
        return [segment_path(numbered_path(one, self._place), number) for one in files]

    def _share(self, table: SinkConfig, infos: tuple[StreamInfo, ...]) -> _Share:
        return _Share(SinkSet([make_sink(table)], self._meter, self._warn), infos)
