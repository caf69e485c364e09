"""A sweep's front, what the presets should be, and the table, from records that are made up."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from evs.drivers.run.config import PRESETS
from evs.msgs import EvsError
from evs_lab.sweep import preset_choice as chosen
from evs_lab.sweep.pareto_front import (
    ERROR_METRICS,
    error_metric,
    pareto_front,
    pareto_points,
    unmatched,
)
from evs_lab.sweep.record import FRAMES, STAGES, Accuracy, ConfidenceInterval, Speed, SweepRecord
from evs_lab.sweep.table import SweepInfo, case_table, in_order, markdown, peers, with_interval


def speed_of(factor: float) -> Speed:
    def around(value: float) -> ConfidenceInterval:
        return ConfidenceInterval(value, 0.9 * value, 1.2 * value, 5)

    stages = {name: around(0.1 * k / factor) for k, name in enumerate(STAGES, 1)}
    return Speed(around(factor), around(2 / factor), around(3 / factor), stages, 89960.0, 40)


def error_of(off: float, own: float = 0.01) -> Accuracy:
    """Recall and precision both 1 - off."""
    share = 1.0 - off
    return Accuracy(
        0.5 * off, 2 * own, share, share, 3 * off, 1 + off, 1 - off, 0.125, 0.25, 1 - 2 * own
    )


def record(
    factor: float | None,
    off: float | None,
    preset: str = "fast",
    axis: str = "",
    value: str = "",
    *,
    kind: str = "ours",
    scene: str = "a.xml",
    camera: str = "still",
    **settings: str | int,
) -> SweepRecord:
    keys = {key.replace("__", "."): text for key, text in settings.items()}
    speed = None if factor is None else speed_of(factor)
    error = None if off is None else error_of(off)
    return SweepRecord(scene, camera, preset, axis, value, keys, kind, speed, error)


@pytest.mark.parametrize(
    ("recall", "precision", "wanted"),
    [
        (1.0, 1.0, 0.0),
        (0.0, math.nan, 1.0),  # silence
        (math.nan, 0.0, 1.0),  # events where there should be none
        (0.0, 0.0, 1.0),
        (0.8, 0.8, 0.2),
        # 8 of 10 found, by 16 events: 16 of 26 events have a partner
        (0.8, 0.5, 1 - 16 / 26),
    ],
)
def test_the_share_without_a_partner(recall: float, precision: float, wanted: float) -> None:
    assert unmatched(recall, precision) == pytest.approx(wanted)


def test_where_nothing_happens_nothing_is_wrong_or_right() -> None:
    assert math.isnan(unmatched(math.nan, math.nan))
    dark = replace(error_of(0.1), recall=math.nan, precision=math.nan)
    assert pareto_points([replace(record(1.0, 0.1), error=dark)]) == []


def test_the_front_leaves_out_what_is_worse_in_both() -> None:
    best = [record(4.0, 0.4), record(1.0, 0.2), record(0.1, 0.05)]
    worse = [record(3.0, 0.4), record(1.0, 0.3), record(0.05, 0.06)]
    assert [
        pareto_point.record for pareto_point in pareto_front(pareto_points([*worse, *best]))
    ] == best


def test_better_than_the_reference_knows_itself_is_no_better() -> None:
    """Its own error is 0.01: of two below that the faster stays."""
    fast, slow = record(0.2, 0.008), record(0.1, 0.002)
    assert [pareto_point.record for pareto_point in pareto_front(pareto_points([slow, fast]))] == [
        fast
    ]
    assert [pareto_point.error for pareto_point in pareto_points([slow])] == [pytest.approx(0.002)]


def test_another_sensor_and_other_peoples_ways_are_not_on_the_front() -> None:
    small = record(9.0, 0.01, axis="resolution", value="8 x 8", sensor__width=8)
    peer = record(8.0, 0.01, kind=FRAMES)
    ours = record(1.0, 0.1, axis="samples", value="direct 4", render__spp=4)
    every = pareto_points([small, peer, ours])
    assert [pareto_point.record for pareto_point in pareto_front(every)] == [ours]
    assert [pareto_point.record for pareto_point in pareto_front(every, FRAMES)] == [peer]


def test_a_record_without_a_speed_or_an_error_has_no_place() -> None:
    assert pareto_points([record(None, 0.1), record(1.0, None)]) == []


def test_figures_by_name() -> None:
    assert error_metric("emd").of(error_of(0.2)) == pytest.approx(0.1)
    assert error_metric("emd").reference_error(error_of(0.2)) == pytest.approx(0.01)
    assert error_metric("unmatched") is ERROR_METRICS["unmatched"]
    with pytest.raises(EvsError, match="no figure of error 'end'; there is: emd"):
        error_metric("end")


def trade(scene: str = "a.xml", slower: float = 1.0) -> list[SweepRecord]:
    def one(factor: float, off: float, *words: str, **settings: str | int) -> SweepRecord:
        return record(slower * factor, off, *words, scene=scene, **settings)

    return [
        one(4.0, 0.5, "fast"),
        one(2.0, 0.3, "fast", "samples", "direct 4", render__spp=4),
        one(6.0, 0.2, "fast", "resolution", "8 x 8", sensor__width=8),
        one(5.0, 0.2, "fast", "threads", "4 threads", threads=4),
        one(0.4, 0.2, "balanced"),
        one(0.02, 0.05, "accurate"),
        one(0.03, 0.06, "accurate", "seeds", "fresh", render__seeds="fresh"),
        one(0.0010, 0.009, "reference"),
        one(0.0015, 0.010, "reference", "samples", "path 512", render__spp=512),
    ]


def test_what_each_preset_should_be() -> None:
    found = {choice.preset: choice for choice in chosen.choose(trade())}
    assert tuple(found) == PRESETS
    # real time, and no other sensor or machine
    assert found["fast"].chosen.label == "fast, samples direct 4"
    assert found["balanced"].stays
    assert found["accurate"].stays
    # the reference's own error is 0.01, so the faster of the two
    assert found["reference"].chosen.label == "reference, samples path 512"
    assert all(choice.reached for choice in found.values())
    text = chosen.choice_text(list(found.values()))
    assert "fast      should be: fast, samples direct 4\n" in text
    assert "balanced  stays\n" in text
    assert "evs emulate fast render.spp=4\n" in text
    assert "evs emulate reference render.spp=512\n" in text


def test_a_preset_is_judged_on_the_mean_of_all_scenes() -> None:
    found = {c.preset: c for c in chosen.choose([*trade(), *trade("heavy.xml", 0.2)])}
    # direct 4 is at 2 and at 0.4
    assert found["fast"].chosen.label == "fast"
    assert found["fast"].chosen.speed == pytest.approx((4 * 0.8) ** 0.5)
    assert found["fast"].chosen.slowest.scene == "heavy.xml"
    text = chosen.choice_text(list(found.values()))
    assert "1.79, 0.8 where it is slowest (heavy.xml, still)" in text


def test_what_was_not_measured_everywhere_cannot_be_a_preset() -> None:
    heavy = [r for r in trade("heavy.xml") if r.axis != "samples"]
    found = {c.preset: c for c in chosen.choose([*trade(), *heavy])}
    assert found["fast"].stays
    assert found["reference"].stays
    other = [record(1.0, 0.1, "balanced", scene="b.xml")]
    assert chosen.choose([record(1.0, 0.1), *other]) == []
    assert chosen.choice_text([]).startswith("no preset was measured on every scene")


def test_a_preset_that_was_not_swept_is_not_chosen() -> None:
    """Else the nearest of the others would stand in for it."""
    swept = [r for r in trade() if r.preset in ("fast", "balanced")]
    found = chosen.choose(swept)
    assert [choice.preset for choice in found] == ["fast", "balanced"]
    text = chosen.choice_text(found)
    assert "accurate  was not measured everywhere\nreference was not measured everywhere\n" in text


def test_where_nothing_is_fast_enough_the_fastest_stands_in() -> None:
    found = {c.preset: c for c in chosen.choose(trade(slower=0.1))}
    assert not found["fast"].reached
    assert found["fast"].chosen.label == "fast"
    assert "nothing reaches 1; this is the fastest" in chosen.choice_text(list(found.values()))


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_the_tables_numbers_are_those_of_the_records() -> None:
    records = [*trade(), record(0.5, 0.4, "accurate", "frames", "60 FPS", kind=FRAMES)]
    headings, _, *rows = case_table(records)
    assert len(rows) == len(records)
    assert [len(cells(row)) for row in rows] == [len(cells(headings))] * len(rows)
    for row, one in zip(rows, in_order(records), strict=True):
        shown = dict(zip(cells(headings), cells(row), strict=True))
        assert (shown["around"], shown["axis"], shown["value"]) == (one.preset, one.axis, one.value)
        assert one.speed is not None
        assert one.error is not None
        factor = one.speed.real_time_factor
        median, low, high = (float(word.strip("[],")) for word in shown["real-time factor"].split())
        assert (median, low, high) == pytest.approx((factor.median, factor.low, factor.high), 5e-3)
        stages = [float(word) for word in shown[cells(headings)[7]].split("/")]
        wanted = [one.speed.stage_ms[name].median for name in STAGES]
        assert stages == pytest.approx(wanted, rel=5e-2)
        for heading, value in (
            ("EMD", one.error.emd),
            ("recall", one.error.recall),
            ("precision", one.error.precision),
            ("unmatched", 1 - one.error.recall),
            ("spurious Hz", one.error.spurious_hz),
            ("ON", one.error.count_ratio_on),
            ("OFF", one.error.count_ratio_off),
            ("delay ms", 0.125),
            ("timing ms", 0.25),
        ):
            assert float(shown[heading]) == pytest.approx(value, rel=5e-3), heading
        assert shown["rays a tick"] == "89,960"
        on_front = one in [
            pareto_point.record for pareto_point in pareto_front(pareto_points(records))
        ]
        assert (cells(row)[3] == "●") == on_front


def test_presets_stand_first_and_other_ways_last() -> None:
    peer = record(0.5, 0.4, "accurate", "frames", "60 FPS", kind=FRAMES)
    mixed = [peer, *reversed(trade())]
    ordered = in_order(mixed)
    assert [r.preset for r in ordered[:4]] == list(PRESETS)
    assert [r.axis for r in ordered[:4]] == [""] * 4
    assert ordered[-1] is peer
    around = [r.preset for r in ordered[4:-1]]
    assert around == sorted(around, key=PRESETS.index)


def test_the_page_says_what_holds_for_all() -> None:
    about = SweepInfo(
        "evs sweep a.xml", "two cores", {"evs": "1.2", "mujoco": "4"}, "a loop", "1024"
    )
    peer = record(0.5, 0.4, "accurate", "frames", "60 FPS", kind=FRAMES)
    page = markdown([*trade(), *trade("b.xml"), peer], about)
    assert page.startswith(
        "    evs sweep a.xml\n\nMachine: two cores.\nVersions: evs 1.2, mujoco 4."
    )
    assert "Yardstick: a loop.\nReference: 1024.\n" in page
    assert (
        "| scene | camera | fast | balanced | accurate | reference | the reference's own |" in page
    )
    assert "| a.xml | still | 4x, 0.5, 0.25 | 0.4x, 0.2, 0.1 |" in page
    assert "| a.xml | still | 0.5x, 0.4, 0.2 |" in page
    assert "## a.xml, camera still" in page
    assert "## b.xml, camera still" in page
    assert page.count("The reference's own error: unmatched 0.01, emd 0.01.") == 2
    assert "    fast      should be: fast, samples direct 4\n" in page
    # what was measured on both scenes, the fastest first; the peer was measured on one
    means = page.partition("## Means over scenes and cameras")[2].partition("##")[0]
    rows = [line for line in means.splitlines() if line.startswith("| ")][1:]
    assert rows[0] == "| fast | 4 | 0.5 |"
    assert "ESIM" not in means
    assert "60 FPS" not in means
    speeds = [float(row.split(" | ")[1]) for row in rows]
    assert speeds == sorted(speeds, reverse=True)
    assert len(rows) > 4


def test_peers_on_the_light_of_several_presets_are_told_apart() -> None:
    words = ("frames", "60 FPS")
    one = record(0.5, 0.4, "accurate", *words, kind=FRAMES)
    two = record(2.0, 0.6, "fast", *words, kind=FRAMES)
    assert peers([one])[0] == "| scene | camera | 60 FPS |"
    assert peers([one, two])[0] == "| scene | camera | accurate, 60 FPS | fast, 60 FPS |"
    assert peers([one, two])[2:] == ["| a.xml | still | 0.5x, 0.4, 0.2 | 2x, 0.6, 0.3 |"]
    assert peers([record(1.0, 0.1)]) == []


def test_half_measured_records_are_shown_with_dashes() -> None:
    page = markdown([record(None, 0.1), record(1.0, None, "balanced")])
    assert "| a.xml | still | -, 0.1, 0.05 | 1x, - |" in page
    assert "presets cannot be chosen" in page
    assert "No errors were measured here." in markdown([record(1.0, None)])


def test_one_repeat_has_no_interval() -> None:
    assert with_interval(ConfidenceInterval(2.5, math.nan, math.nan, 1)) == "2.5"
    assert with_interval(ConfidenceInterval(2.5, 2.0, 1234567.0, 5)) == "2.5 [2, 1,234,567]"
