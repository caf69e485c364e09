"""Write the report of a run: one file that fails does not stop the others."""

from __future__ import annotations

from pathlib import Path

from evs.drivers.run.report import Report
from evs.launch.support.report_writer import ReportWriter


def test_the_other_files_are_written(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    writer = ReportWriter([tmp_path / "folder", tmp_path / "report.json"])
    writer(Report(events=3))
    assert '"events": 3' in (tmp_path / "report.json").read_text()
    assert len(writer.failures) == 1
