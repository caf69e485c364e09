"""Write the report of a run: one file that fails does not stop the others."""

from __future__ import annotations

from pathlib import Path

import pytest

from evs.drivers.run.report import Report
from evs.launch.support.report_writer import ReportWriter


def test_no_memory_for_a_report_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # what ended the run is still to be told: an exception would take its place
    def exhausted(_: Report) -> str:
        raise MemoryError

    monkeypatch.setattr(Report, "to_json", exhausted)
    writer = ReportWriter([tmp_path / "report.json"])
    writer(Report())
    assert [str(error) for error in writer.failures] == [
        f"cannot write '{tmp_path / 'report.json'}': out of memory"
    ]
    assert "out of memory" in capsys.readouterr().err


def test_the_other_files_are_written(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    writer = ReportWriter([tmp_path / "folder", tmp_path / "report.json"])
    writer(Report(events=3))
    assert '"events": 3' in (tmp_path / "report.json").read_text()
    assert len(writer.failures) == 1
