"""The file of a sweep: lines of JSON, first a header, then each record as it is finished.

A line is written and synchronised at once, so a sweep that ends early keeps its records, and the
same command continues it. An incomplete last line is ignored, and overwritten.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evs.drivers.run.report import write_whole
from evs.emulator.base.small_files import open_file
from evs.msgs import EvsError
from evs_lab.sweep.record import SweepRecord, merged

KEY = "sweep"
"""of the first line"""

SHAPING = ("evs", "mujoco")
"""packages whose versions all records of a file have in common"""


@dataclass(frozen=True)
class SweepHeader:
    """The first line: the settings that make records comparable, and the machine."""

    settings: Mapping[str, Any]
    """of errors and speeds, without scenes, presets and axes: one file may hold any of these"""
    about: Mapping[str, Any]
    """machine, versions, yardstick, command"""

    def to_json(self) -> str:
        """One line."""
        return json.dumps({KEY: {"settings": self.settings, "about": self.about}})


class SweepStore:
    """A sweep's records on disk.

    Raises:
        EvsError: not readable, or of another sweep.
    """

    def __init__(self, path: Path, header: SweepHeader) -> None:
        """Open the file, or begin it."""
        self.path = path
        self._lines: list[SweepRecord] = []
        if path.exists() and path.stat().st_size:
            found, self._lines, whole = _read(path)
            self._check(found, header)
            self.header = found
            if whole < path.stat().st_size:
                _cut(path, whole)
        else:
            self.header = header
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as reason:
                raise self._cannot(reason) from None
            self._append(header.to_json())

    @property
    def records(self) -> list[SweepRecord]:
        """Every point once, speed and error together."""
        return merged(self._lines)

    def add(self, record: SweepRecord) -> None:
        """Append a record; it is on the disk when this returns."""
        self._append(record.to_json())
        self._lines.append(record)

    def begin_timings(self, about: Mapping[str, Any]) -> None:
        """Declare that speeds of this machine follow; the header of the file names the machine.

        Raises:
            EvsError: the file holds timings of another machine.
        """
        there, here = self.header.about.get("machine"), about.get("machine")
        if there == here:
            return
        if any(one.speed is not None for one in self._lines):
            raise EvsError(
                f"the timings of '{self.path}' are of another machine ({there}; here: {here}): "
                "give another --json"
            )
        self.header = SweepHeader(self.header.settings, dict(about))
        lines = [self.header.to_json(), *(one.to_json() for one in self._lines)]
        write_whole("".join(f"{line}\n" for line in lines), self.path)

    def _append(self, line: str) -> None:
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as reason:
            raise self._cannot(reason) from None

    def _cannot(self, reason: OSError) -> EvsError:
        return EvsError(
            f"cannot write '{self.path}': {reason.strerror}; what it holds is kept: make room, or "
            "give another --json"
        )

    def _check(self, found: SweepHeader, wanted: SweepHeader) -> None:
        """Refuse a file with other settings or versions."""
        differing = [
            f"{name} {found.settings.get(name)} there, {value} here"
            for name, value in wanted.settings.items()
            if found.settings.get(name) != value
        ]
        there, here = (about.get("versions") or {} for about in (found.about, wanted.about))
        differing += [
            f"{name} {there.get(name)} there, {here.get(name)} here"
            for name in SHAPING
            if there.get(name) != here.get(name)
        ]
        if differing:
            raise EvsError(
                f"'{self.path}' is of another sweep ({'; '.join(differing)}): give another --json, "
                "or what it was begun with"
            )


def read_sweep(path: Path) -> tuple[SweepHeader, list[SweepRecord]]:
    """Read a sweep's file, every point once. Raises EvsError."""
    header, lines, _ = _read(path)
    return header, merged(lines)


def _read(path: Path) -> tuple[SweepHeader, list[SweepRecord], int]:
    """(header, records line by line, bytes of all whole lines)."""
    try:
        with open_file(path) as file:
            data = file.read()
    except OSError as reason:
        raise EvsError(f"cannot read '{path}': {reason.strerror}") from None
    lines = list(_whole_lines(data))
    header = _header(lines[0]) if lines else None
    if header is None:
        raise EvsError(f"'{path}' is no file of a sweep; give another --json")
    records = []
    for number, line in enumerate(lines[1:], 2):
        try:
            records.append(SweepRecord.from_json(line))
        except EvsError as error:
            raise EvsError(f"'{path}', line {number}: {error}") from None
    return header, records, data.rfind(b"\n") + 1


def _whole_lines(data: bytes) -> Iterator[str]:
    for line in data.split(b"\n")[:-1]:
        yield line.decode("utf-8", errors="replace")


def _header(line: str) -> SweepHeader | None:
    try:
        data = json.loads(line)[KEY]
        return SweepHeader(dict(data["settings"]), dict(data["about"]))
    except (ValueError, KeyError, TypeError):
        return None


def _cut(path: Path, size: int) -> None:
    """Remove an incomplete last line."""
    try:
        os.truncate(path, size)
    except OSError as reason:
        raise EvsError(f"cannot mend '{path}': {reason.strerror}; give another --json") from None
