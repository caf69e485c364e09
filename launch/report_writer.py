"""The run report, as files."""

from __future__ import annotations

from pathlib import Path

from evs.drivers.run.report import Report, report_beside, write_report
from evs.launch import terminal
from evs.msgs import EvsError


class Keeper:
    """Writes the report where it is wanted."""

    def __init__(self, targets: list[Path]) -> None:
        self.unkept: list[EvsError] = []
        """why it could not be written somewhere"""
        self._targets = targets

    def __call__(self, report: Report) -> None:
        """Write it everywhere."""
        beside = [report_beside(file) for file in report.loop.get("files", ())]
        for target in [*self._targets, *beside]:
            try:
                write_report(report, target)
            except EvsError as error:
                # a full disk: the others, and what ended the run, matter more
                self.unkept.append(error)
                terminal.warn(str(error))
