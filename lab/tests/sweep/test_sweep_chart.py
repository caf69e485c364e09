"""The Pareto picture: where its names stand, and what is drawn."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.pictures.chart import INK_RGB, draw_charts
from evs_lab.commands import sweep as launch_sweep
from evs_lab.sweep.pareto_chart import (
    CHART_PX,
    COLOURS,
    PEERS,
    legend,
    pareto_chart,
    pareto_page,
    steps_around,
)
from evs_lab.sweep.pareto_front import ERROR_METRICS
from evs_lab.sweep.point_names import POINT_PX, Box, Name, names_of, overlap
from evs_lab.sweep.record import (
    FRAMES,
    PAPER,
    STAGES,
    Accuracy,
    ConfidenceInterval,
    Speed,
    SweepRecord,
)


def measured(
    factor: float, off: float, preset: str, value: str = "", kind: str = "ours", camera: str = "pan"
) -> SweepRecord:
    one = ConfidenceInterval(factor, 0.8 * factor, 1.25 * factor, 5)
    speed = Speed(one, one, one, dict.fromkeys(STAGES, one), 1.0, 10)
    error = Accuracy(off, 0.04, 1 - off, 1 - off, off, 1.0, 1.0, 0.0, 0.0, 0.96)
    axis = "samples" if value else ""
    return SweepRecord("a.xml", camera, preset, axis, value, {}, kind, speed, error)


def crowd() -> list[SweepRecord]:
    """Presets, forty points around them, many on top of each other, and peers."""
    drawn = np.random.default_rng(3)
    found = [
        measured(factor, off, preset)
        for preset, factor, off in (
            ("fast", 3.0, 0.4), ("balanced", 0.3, 0.2), ("accurate", 0.03, 0.06),
            ("reference", 0.001, 0.02),
        )
    ]  # fmt: skip
    for k in range(40):
        base = found[k % 4]
        assert base.speed is not None
        assert base.error is not None
        found.append(
            measured(
                base.speed.real_time_factor.median * math.exp(0.3 * drawn.normal()),
                min(1.0, base.error.emd * math.exp(0.2 * drawn.normal())),
                base.preset,
                f"value {k}",
            )
        )
    found += [measured(5.0 / 2**k, 0.5, "accurate", f"{60 * 2**k} FPS", FRAMES) for k in range(4)]
    return [*found, measured(0.01, 0.3, "accurate", "its network", PAPER)]


def placed() -> tuple[list[Name], Box, list[Box]]:
    """The names of the crowd, the axes, and boxes of its points and their bars, px."""
    chart = pareto_chart(crowd())
    names: list[Name] = []
    boxes: list[Box] = []
    frame: list[float] = []

    def look(axes: Any, _: int) -> None:
        names.extend(names_of(axes, chart))
        frame.extend(axes.get_window_extent().extents)
        for series in chart.series:
            for k, (x, y) in enumerate(zip(series.x, series.y, strict=True)):
                if not series.line:
                    low, high = series.x_range[k]
                    ends = axes.transData.transform([(low, y), (x, y), (high, y)])
                    left, (right, at) = ends[1] - POINT_PX, ends[1] + POINT_PX
                    boxes.append((left[0], left[1], right, at))
                    boxes.append((ends[0, 0], ends[0, 1], ends[2, 0], ends[2, 1]))

    draw_charts([chart], 1, CHART_PX, finish=look)
    return names, (frame[0], frame[1], frame[2], frame[3]), boxes


def test_names_stay_inside_and_overlap_nothing() -> None:
    names, (left, bottom, right, top), boxes = placed()
    for name in names:
        assert name.box[0] >= left
        assert name.box[1] >= bottom
        assert name.box[2] <= right
        assert name.box[3] <= top
        assert not any(overlap(name.box, box) for box in boxes), name.words
    for one, two in itertools.combinations(names, 2):
        assert not overlap(one.box, two.box), (one.words, two.words)


def test_what_matters_has_its_name_even_in_a_crowd() -> None:
    words = {name.words for name in placed()[0]}
    assert {"fast", "balanced", "accurate", "reference", "its network"} <= words
    assert {"60 FPS", "120 FPS", "240 FPS", "480 FPS"} <= words
    assert len(words) > 20


def test_every_point_is_drawn_once_in_its_mark() -> None:
    records = crowd()
    chart = pareto_chart(records)
    dots = [s for s in chart.series if not s.line]
    drawn = sorted((x, y) for s in dots for x, y in zip(s.x, s.y, strict=True))
    wanted = sorted((r.speed.real_time_factor.median, r.error.emd) for r in records
                    if r.speed and r.error)  # fmt: skip
    assert np.allclose(drawn, wanted)
    for kind in (FRAMES, PAPER):
        mark, colour, _ = PEERS[kind]
        assert [s.mark for s in dots if s.colour == colour] == [mark]
    presets = [s for s in dots if s.mark == "^"]
    assert [s.colour for s in presets] == list(COLOURS.values())
    assert [len(s.x) for s in presets] == [1, 1, 1, 1]
    # the front is a line to the left and down
    line = next(s for s in chart.series if s.line)
    assert list(line.x) == sorted(line.x, reverse=True)
    assert list(line.y) == sorted(line.y, reverse=True)
    assert [words for _, words in chart.marks] == ["the reference's own error"]
    assert math.isclose(chart.marks[0][0], 0.02)
    assert [level for level, _ in chart.posts] == [1.0]
    picture = draw_charts([chart], 1, CHART_PX)
    for colour in (INK_RGB, *COLOURS.values(), *(PEERS[kind][1] for kind in PEERS)):
        assert np.any(np.all(picture == np.array(colour, np.uint8), axis=2)), colour


def test_a_page_has_a_chart_for_each_camera() -> None:
    still = [measured(1.0, 0.1, "fast", camera="still")]
    one, two = pareto_page(still), pareto_page([*still, *crowd()])
    assert two.shape[0] - one.shape[0] == CHART_PX[1]
    assert two.shape[1] == one.shape[1]
    assert two.dtype == np.uint8


def test_a_long_path_fits_on_the_page() -> None:
    records = [replace(one, scene="/data" + "/folder" * 30 + "/arm.xml") for one in crowd()]
    assert pareto_page(records).shape == pareto_page(crowd()).shape


def test_nothing_to_show_is_said() -> None:
    blind = SweepRecord("a.xml", "still", "fast", "", "", {})
    assert pareto_chart([blind]).empty
    assert pareto_page([blind]).shape[1] > 0
    assert not pareto_chart(crowd()).empty


def test_no_error_at_all_stands_on_the_axis() -> None:
    chart = pareto_chart([measured(1.0, 0.0, "fast"), measured(0.5, 0.2, "balanced")])
    drawn = [y for s in chart.series if not s.line for y in s.y]
    assert min(drawn) == chart.y.low > 0.0
    assert pareto_chart(crowd(), ERROR_METRICS["emd"]).marks[0][0] == 0.02


def test_axes_end_at_round_numbers_with_room() -> None:
    assert steps_around([]) == (0.1, 10.0)
    assert steps_around([math.nan, 0.0]) == (0.1, 10.0)
    for values in ([0.3], [1.0, 10.0], [0.0123, 7.7], [1e-5, 1e3]):
        low, high = steps_around(values)
        assert low < min(values)
        assert high > max(values)
        assert high >= 9.99 * low
        assert low > min(values) / 3.0
        for end in (low, high):
            mantissa = end / 10.0 ** math.floor(math.log10(end) + 1e-9)
            assert min(abs(mantissa - m) for m in (1.0, 2.0, 5.0, 10.0)) < 1e-6


def test_each_scene_has_a_file_of_its_own() -> None:
    scenes = ("a/b.xml", "a_b.xml", "a/b.xml", "c")
    files = launch_sweep._pictures(Path("out/all.png"), scenes)
    assert {scene: file.name for scene, file in files.items()} == {
        "a/b.xml": "all-a_b.png",
        "a_b.xml": "all-a_b_2.png",
        "c": "all-c.png",
    }
    assert launch_sweep._pictures(Path("one.png"), ("a.xml",)) == {"a.xml": Path("one.png")}


def test_the_legend_says_what_the_line_is() -> None:
    assert legend(ERROR_METRICS["emd"]).startswith(
        "error: EMD, events per pixel; line: the front; bars"
    )
