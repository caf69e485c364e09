"""The report as a file: whole or not there, and refused early where it cannot be written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.clock import StageTime
from evs.drivers.run.report import Report, check_targets, report_beside, versions, write_report
from evs.msgs import EvsError

REPORT = Report(ticks=3, stage_ms={"world": StageTime(0.5, 0.75)}, seed=2**62)


def test_a_report_is_written_and_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    path.write_text("what stood there before")
    write_report(REPORT, path)
    fields = json.loads(path.read_text())
    assert fields["ticks"] == 3
    assert fields["stage_ms"] == {"world": {"median": 0.5, "p99": 0.75}}
    assert fields["seed"] == 2**62
    assert [file.name for file in tmp_path.iterdir()] == ["report.json"]


def test_numpy_values_become_plain_ones() -> None:
    odd = Report(config={"a": np.int64(3), "b": np.arange(2), "c": np.float32(0.5), "d": Path("x")})
    assert json.loads(odd.to_json())["config"] == {"a": 3, "b": [0, 1], "c": 0.5, "d": "x"}


def test_the_recordings_report_stands_beside_it() -> None:
    assert report_beside("out/run.aedat4") == Path("out/run.aedat4.report.json")


def test_versions_name_what_shaped_the_events() -> None:
    assert {"python", "numpy", "mujoco", "msgpack", "pyzmq"} <= set(versions())


@pytest.mark.parametrize("name", ["missing/report.json", "folder", "file/report.json"])
def test_a_report_that_cannot_be_written_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(EvsError, match="cannot write") as early:
        check_targets([tmp_path / name])
    with pytest.raises(EvsError, match="cannot write") as late:
        write_report(REPORT, tmp_path / name)
    assert "\n" not in f"{early.value}{late.value}"
    assert ("mkdir -p" in str(early.value)) == name.startswith("missing")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_check_leaves_nothing_and_harms_nothing(tmp_path: Path) -> None:
    old = tmp_path / "old.json"
    old.write_text("{}")
    check_targets([old, tmp_path / "new.json"])
    assert old.read_text() == "{}"
    assert list(tmp_path.iterdir()) == [old]


def test_a_device_is_written_not_replaced() -> None:
    write_report(REPORT, "/dev/null")
    assert Path("/dev/null").is_char_device()
    with pytest.raises(EvsError, match="No space left"):
        write_report(REPORT, "/dev/full")
