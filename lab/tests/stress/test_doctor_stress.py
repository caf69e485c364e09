"""`evs doctor` and the extremes: its lines, its exit code, its JSON, the table that it writes."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from evs.drivers.run.stop_signals import stop_signals
from evs.launch.commands import doctor
from evs.launch.main import main
from evs.msgs import EvsError
from evs.tools.doctor import trial
from evs_lab import stress
from evs_lab.stress import (
    GROUPS,
    CaseResult,
    Measurement,
    StressCase,
    cases_of,
    stress_case,
)
from evs_lab.stress.report import BEGIN, END, measured, rows_of, write_table

PAGE = Path(__file__).parents[3] / "lab/docs/extremes.md"

GOOD = Measurement(0.263, 1.0019, "thresholds", ("4 events", "a|b"))
BAD = Measurement(2.5, 1.0, "ms")
UNRECOVERED = Measurement(0, 0, "events", recovered=False)


def tried(measurement: Measurement | None, name: str = "one", error: str = "") -> CaseResult:
    case = StressCase(name, "light", "what | is done", "its bound", lambda _short: GOOD)
    return CaseResult(case, measurement, error, 0.5)


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> list[CaseResult]:
    """What stands in for the run of the extremes; the trial run is left out."""
    results: list[CaseResult] = []

    def run(
        *,
        short: bool,
        on_done: Callable[[CaseResult], None] | None,
        groups: tuple[str, ...] = GROUPS,
    ) -> list[CaseResult]:
        for one in results:
            if on_done is not None:
                on_done(one)
        return results

    monkeypatch.setattr(trial, "check_pipeline", lambda folder: [])
    monkeypatch.setattr(trial, "check_timing", doctor_check)
    monkeypatch.setattr(stress, "run_cases", run)
    return results


def doctor_check() -> object:
    from evs.tools.doctor import Check

    return Check("timing", "ok", "not looked")


def test_each_is_a_line_with_measured_value_and_bound(
    found: list[CaseResult], capsys: pytest.CaptureFixture[str]
) -> None:
    found += [tried(GOOD), tried(Measurement(1234567, 1e7, "events"), "two")]
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "ok   one                      0.263 thresholds, at most 1" in lines
    assert "ok   two                      1,234,567 events, at most 10,000,000" in lines
    assert lines[-1] == doctor.FIT


@pytest.mark.parametrize(
    ("one", "messages"),
    [
        (tried(BAD), "2.5 ms, at most 1"),
        (tried(UNRECOVERED),
         "0 events, at most 0, and the stream or its report is wrong afterwards"),
        (tried(None, error="EvsError: it broke"), "stopped by EvsError: it broke"),
        (tried(Measurement(math.nan, 1.0, "us")), "nan us, at most 1"),
    ],
)  # fmt: skip
def test_one_that_fails_makes_the_exit_code(
    one: CaseResult, messages: str, found: list[CaseResult], capsys: pytest.CaptureFixture[str]
) -> None:
    found += [tried(GOOD), one]
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert f"FAIL one                      {messages}" in out
    assert out.splitlines()[-1] == doctor.BROKEN
    assert main(["doctor", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)["extremes"]
    assert [each["holds"] for each in told] == [True, False]
    assert set(told[0]) >= {"name", "group", "bound", "value", "limit", "unit", "said", "recovered"}


def test_quick_leaves_them_out_and_an_unfit_machine_is_not_tried(
    found: list[CaseResult], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found.append(tried(BAD))
    assert main(["doctor", "--quick"]) == 0
    monkeypatch.setattr(trial, "check_pipeline", lambda folder: 1 / 0)
    assert main(["doctor"]) == 1
    assert "FAIL" not in capsys.readouterr().out


def test_the_table_is_written_whole_into_a_new_file_or_a_page(
    found: list[CaseResult], tmp_path: Path
) -> None:
    found += [tried(GOOD), tried(BAD, "two"), tried(None, "three", "it broke")]
    file = tmp_path / "new.md"
    assert main(["doctor", "--markdown", str(file)]) == 1
    text = file.read_text()
    row = r"| `one` | what \| is done | its bound | 0.263 thresholds, at most 1 | 4 events; a\|b |"
    assert row in text.splitlines()
    assert "| **FAILS** 2.5 ms, at most 1 |" in text
    assert list(rows_of(text)) == [
        ("light", name, "what | is done", "its bound") for name in ("one", "two", "three")
    ]
    page = tmp_path / "page.md"
    page.write_text(f"Above\n\n{BEGIN}\nlast year\n{END}\n\nBelow\n")
    found[1:] = []
    assert main(["doctor", "--markdown", str(page)]) == 0
    written = page.read_text()
    assert written.startswith(f"Above\n\n{BEGIN}\n\n### Light\n")
    assert written.endswith(f"{END}\n\nBelow\n")
    assert "last year" not in written
    # and again the same
    write_table(page, found)
    assert page.read_text() == written


def test_a_file_that_is_no_page_is_left_as_it_is(found: list[CaseResult], tmp_path: Path) -> None:
    file = tmp_path / "notes.md"
    file.write_text("mine")
    with pytest.raises(EvsError, match="has no place for the table"):
        write_table(file, found)
    assert file.read_text() == "mine"
    assert main(["doctor", "--markdown", str(tmp_path / "none" / "x.md")]) == 2


def test_the_page_has_a_row_for_every_extreme_with_its_bound() -> None:
    """Written by `evs doctor --markdown lab/docs/extremes.md`; again where this fails."""
    registry = [
        (group, one.name, " ".join(one.what.split()), " ".join(one.bound.split()))
        for group in GROUPS
        for one in cases_of(group)
    ]
    assert list(rows_of(PAGE.read_text(encoding="utf-8"))) == registry
    assert "FAILS" not in PAGE.read_text(encoding="utf-8")


def test_a_number_is_told_as_people_write_it() -> None:
    assert measured(tried(Measurement(0.0, 0, "events"))) == "0 events, at most 0"
    assert measured(tried(Measurement(1e-9, 0.5))) == "1e-09, at most 0.5"
    assert measured(tried(Measurement(math.inf, 1))) == "inf, at most 1"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_doctor_ends_in_the_middle_of_its_cases(
    number: int, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def runs() -> Measurement:
        with stop_signals() as stopped:
            signal.raise_signal(number)
            assert stopped
        raise AssertionError("the case went on")

    case = StressCase("endless", "light", "", "", lambda short: runs())
    monkeypatch.setattr(stress_case, "cases_of", lambda group: (case,))
    monkeypatch.setattr(doctor, "examine", lambda: iter(()))
    try:
        found = main(["doctor"])
    except SystemExit as ended:
        found = ended.code
    assert found == code
