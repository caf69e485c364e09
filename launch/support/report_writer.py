"""Write the report of a run to its files."""

from __future__ import annotations

from pathlib import Path

from evs.drivers.run.report import Report, report_beside, write_report
from evs.launch.support import terminal
from evs.msgs import EvsError


class ReportWriter:
    """Writes the report of a run to every file that asks for it."""

    def __init__(self, targets: list[Path]) -> None:
        self.failures: list[EvsError] = []
        """one for each file that could not be written"""
        self._targets = targets

    def __call__(self, report: Report) -> None:
        """Write it to every file; a failure is a warning."""
        beside = [report_beside(file) for file in report.loop.get("files", ())]
        for target in [*self._targets, *beside]:
            try:
                write_report(report, target)
            except EvsError as error:
                # a full disk: the others, and what ended the run, matter more
                self.failures.append(error)
                terminal.warn(str(error))
