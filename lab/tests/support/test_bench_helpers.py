"""What the benchmarks stand on: turns, tables, and functions in processes of their own."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from speed.elsewhere import AbsentError, elsewhere
from speed.turns import Table, Time, milliseconds, spread, target


def test_calls_take_turns_and_the_first_round_does_not_count() -> None:
    order: list[str] = []

    def slow_at_first() -> None:
        time.sleep(0.002 if "a" in order else 0.2)
        order.append("a")

    times = milliseconds({"a": slow_at_first, "b": lambda: order.append("b")}, rounds=3)
    assert order == ["a", "b"] * 4
    assert 2 <= times["a"].low <= times["a"].median <= times["a"].high < 200
    assert times["b"].median < times["a"].median


def test_spread_is_the_median_and_the_quartiles() -> None:
    assert spread([5, 1, 2, 4, 3]) == Time(3, 2, 4)
    assert Time(3, 2, 4) / 2 == Time(1.5, 1, 2)


def test_a_table_pairs_rows_with_their_yardsticks() -> None:
    column = {"ours": Time(2, 1.5, 3), "theirs": Time(30, 29, 31), "other": Time(1, 1, 1)}
    table = Table("title", {"robot": column}, {"ours": "theirs"})
    assert table.ratio("robot", "ours") == 15
    lines = str(table).splitlines()[1:]
    assert [line.split() for line in lines] == [
        ["title"],
        ["ms:", "median", "(quartiles)", "robot"],
        ["theirs", "30", "(29-31)"],
        ["ours", "2", "(1.5-3)", "15x"],
    ]


@pytest.mark.parametrize(
    ("found", "unit", "verdict"), [(5, "x", "met"), (4.9, "x", "MISSED"), (5, "ms", "met"),
                                   (5.1, "ms", "MISSED")]
)  # fmt: skip
def test_a_target_is_met_at_its_bound(found: float, unit: str, verdict: str) -> None:
    assert target("it", found, 5, unit).endswith(f"{found} {unit}, {verdict}")


SCALE = """
import os

from speed.elsewhere import AbsentError


def make_scale(factor):
    if factor < 0:
        raise AbsentError("no negative factor: give another")
    return lambda value: (os.getpid(), float(os.environ["EVS_TEST_OFFSET"]) + factor * value)
"""


@pytest.fixture
def make_scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Of a module that another process can import too, which a test's own it cannot."""
    (tmp_path / "scale_for_bench_helpers.py").write_text(SCALE)
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.import_module("scale_for_bench_helpers").make_scale  # type: ignore[no-any-return]


def test_a_function_elsewhere_has_its_own_process_and_environment(
    make_scale: Callable[..., Any],
) -> None:
    before = dict(os.environ)
    with elsewhere(make_scale, 3.0, environment={"EVS_TEST_OFFSET": "0.5"}) as scale:
        process, value = scale.call(2.0)
        assert value == 6.5
        assert process != os.getpid()
        assert scale.run(2.0) is None
        assert scale.call(4.0) == (process, 12.5)
    assert dict(os.environ) == before
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_what_is_absent_elsewhere_is_said_here(make_scale: Callable[..., Any]) -> None:
    with (
        pytest.raises(AbsentError, match=r"^no negative factor: give another$"),
        elsewhere(make_scale, -1.0, environment={}),
    ):
        pass
