"""What the loops share: search, limits, units of work, results that can be taken up again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from evs.examples.common.results_file import ResultsFile
from evs.examples.common.search import Budget, Point, cross_entropy, limit
from evs.msgs import EvsError

BOX = {"a": (0.1, 100.0), "b": (0.01, 10.0)}


def test_the_search_finds_a_hill_and_repeats_itself() -> None:
    tried: list[Point] = []

    def score(point: Point) -> float:
        tried.append(point)
        return -((point["a"] / 20.0 - 1.0) ** 2) - (point["b"] / 0.1 - 1.0) ** 2

    begin = {"a": 2.0, "b": 1.0}
    best, height = cross_entropy(score, BOX, begin, Budget(8, 20, 5), seed=4)
    assert len(tried) == 160
    assert tried[0] == pytest.approx(begin)
    assert all(
        BOX[name][0] <= value <= BOX[name][1] * (1 + 1e-12)
        for p in tried
        for name, value in p.items()
    )
    # 160 points in two decades each; by chance alone the best would be at about 0.2
    assert height > -0.01
    assert height == max(map(score, tried[:160]))
    again = cross_entropy(score, BOX, begin, Budget(8, 20, 5), seed=4)
    assert again == (best, height)
    assert cross_entropy(score, BOX, begin, Budget(8, 20, 5), seed=5) != again


def test_a_search_without_sense_is_refused() -> None:
    with pytest.raises(EvsError, match="a is to lie in"):
        cross_entropy(lambda _: 0.0, {"a": (1.0, 2.0)}, {"a": 3.0}, Budget())
    with pytest.raises(EvsError, match="keeps 2 points"):
        cross_entropy(lambda _: 0.0, {"a": (1.0, 2.0)}, {"a": 1.5}, Budget(1, 1, 1))


def test_limits_both_ways_round() -> None:
    found = limit(lambda x: x <= 7.0, 1.0, 100.0, 12)
    assert found is not None
    assert 6.95 < found <= 7.0
    found = limit(lambda x: x >= 0.03, 0.2, 0.005, 12)
    assert found is not None
    assert 0.03 <= found < 0.0302
    assert limit(lambda x: x <= 41, 0, 128, 7, whole=True) == 41
    assert limit(lambda _: True, 1.0, 100.0, 5) == 100.0
    assert limit(lambda _: False, 1.0, 100.0, 5) is None
    with pytest.raises(EvsError, match="nothing to halve"):
        limit(lambda _: True, 1.0, 1.0, 5)


def test_results_are_taken_up_again(tmp_path: Path) -> None:
    file = tmp_path / "table.json"
    first = ResultsFile(file, {"steps": 3, "ends": (1, 2)})
    first.put("events", "longest_ms", 40.0)
    assert json.loads(file.read_text())["rows"] == {"events": {"longest_ms": 40.0}}
    second = ResultsFile(file, {"steps": 3, "ends": (1, 2)})
    assert second.has("events", "longest_ms")
    assert not second.has("60 FPS", "longest_ms")
    with pytest.raises(EvsError, match="made with other options"):
        ResultsFile(file, {"steps": 4, "ends": (1, 2)})
    file.write_text("[1]")
    with pytest.raises(EvsError, match="holds no results"):
        ResultsFile(file, {"steps": 3})
