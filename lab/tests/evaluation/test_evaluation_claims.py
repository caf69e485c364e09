"""What becomes of each claim, on cells made by hand."""

from __future__ import annotations

from typing import Any

import pytest

from evs_lab.evaluation.aggregate import ResultCell
from evs_lab.evaluation.claims import NOTHING, Claim, check_claims, winners
from reference.judged import cell

C8 = "evsnet_c8"


def claim(cells: list[ResultCell], *words: str) -> Claim:
    (found,) = [c for c in check_claims(cells) if all(word in c.claim for word in words)]
    return found


@pytest.mark.parametrize(
    ("spp", "plain", "ours", "silence", "met"),
    [(4, 5.0, 1.0, 1.1, True), (4, 4.99, 1.0, 2.0, False), (16, 5.0, 1.0, 2.0, True),
     (16, 4.9, 1.0, 2.0, False), (64, 3.0, 1.0, 2.0, True), (64, 2.9, 1.0, 2.0, False),
     # far below plain, and no better than no event at all
     (4, 9.5, 1.0, 1.0, False)],
)  # fmt: skip
def test_emd_below_plain_and_below_silence(
    spp: int, plain: float, ours: float, silence: float, met: bool
) -> None:
    cells = [
        cell("plain", spp, emd=plain),
        cell(C8, spp, emd=ours),
        # other samples and other seeds do not count
        cell(C8, spp, "fixed", emd=100.0),
        cell("plain", 2 * spp, emd=100.0),
        cell(NOTHING, 0, "fixed", light="none", emd=silence),
    ]
    found = claim(cells, "EMD at least", f"fresh {spp} spp")
    assert found.met is met
    assert found.figures == (
        f"{plain:.2f}x: plain {plain:.3g}, silence {silence:.3g}, {C8} {ours:.3g}"
    )
    assert claim(cells[:-1], "EMD at least", f"fresh {spp} spp").met is None


def test_scenes_and_cameras_count_together() -> None:
    cells = [
        cell("plain", emd=9.0, camera="still"),
        cell(C8, emd=1.0, camera="still"),
        cell("plain", emd=6.0, camera="pan"),
        cell(C8, emd=2.0, camera="pan"),
        cell(NOTHING, 0, "fixed", light="none", emd=1.5, camera="still"),
        cell(NOTHING, 0, "fixed", light="none", emd=2.5, camera="pan"),
    ]
    found = claim(cells, "EMD at least", "fresh 4 spp")
    assert found.met
    assert found.figures == (
        "5.00x: plain 7.5, silence 2, evsnet_c8 1.5 (still 9.00x: plain 9, silence 1.5, "
        "evsnet_c8 1, pan 3.00x: plain 6, silence 2.5, evsnet_c8 2)"
    )


@pytest.mark.parametrize(
    ("plain", "ours", "met"), [(300, 10, True), (299, 10, False), (10, 0, True), (0, 0, None)]
)
def test_static_false_events(plain: int, ours: int, met: bool | None) -> None:
    cells = [cell("plain", 16, static_events=plain), cell(C8, 16, static_events=ours)]
    assert claim(cells, "static", "fresh 16 spp").met is met


def test_a_camera_before_which_nothing_is_false() -> None:
    cells = [
        cell(model, static_events=events, camera=camera)
        for model, events in (("plain", 60), (C8, 1))
        for camera, events in (("still", events), ("pan", 0))
    ]
    figures = claim(cells, "static", "fresh 4 spp").figures
    assert figures.endswith("per px and s (still 60.0x, pan without any)")


@pytest.mark.parametrize(
    ("ours", "met"),
    [({"emd": 0.9, "pairs": 151}, True), ({"emd": 1.0, "pairs": 151}, False),
     ({"emd": 0.9, "pairs": 150}, False)],
)  # fmt: skip
def test_against_adaptive(ours: dict[str, Any], met: bool) -> None:
    cells = [cell("adaptive", emd=1.0, pairs=150), cell(C8, **ours)]
    found = claim(cells, "adaptive", "fresh 4 spp")
    assert found.met is met
    assert "recall" in found.figures


@pytest.mark.parametrize(
    ("spp", "on", "off", "met"),
    [(4, 110, 90, True), (4, 111, 100, False), (4, 100, 89, False), (16, 105, 95, True),
     (16, 100, 94, False), (64, 95, 105, True), (64, 106, 94, False)],
)  # fmt: skip
def test_counts_of_both_polarities(spp: int, on: int, off: int, met: bool) -> None:
    found = claim([cell(C8, spp, on=on, off=off)], "counts", f"fresh {spp} spp")
    assert found.met is met
    assert found.figures == f"ON {on / 100:.3f}, OFF {off / 100:.3f}, both {(on + off) / 200:.3f}"


MOVING: dict[str, Any] = {"camera": "pan"}
PAPER = cell("paper", 64, "fresh", emd=1.0, pairs=150, on=100, off=100, **MOVING)


def test_four_samples_do() -> None:
    cells = [
        PAPER,
        cell(C8, 4, "fixed", emd=1.0, pairs=150, **MOVING),
        cell(C8, 4, "fresh", emd=0.5, pairs=140, **MOVING),
        cell(C8, 16, "fixed", emd=0.1, pairs=190, **MOVING),
    ]
    found = claim(cells, "paper")
    assert found.met
    assert f"{C8} fixed 4 spp EMD 1, recall 0.750, spurious 0.05 Hz" in found.figures
    assert found.figures.endswith("smallest that does: 4 spp, 16x fewer rays")


@pytest.mark.parametrize(
    "worse", [{"emd": 1.01}, {"emd": 0.5, "pairs": 149}, {"emd": 0.5, "pairs": 150, "on": 101}]
)
def test_sixteen_do(worse: dict[str, Any]) -> None:
    cells = [
        PAPER,
        cell(C8, 4, "fixed", **{"pairs": 150, **MOVING, **worse}),
        cell("plain", 16, "fixed", emd=0.9, pairs=160, **MOVING),
    ]
    found = claim(cells, "paper")
    assert found.met is False
    assert found.figures.endswith("smallest that does: 16 spp, 4x fewer rays")


def test_none_does_and_who_does_not_count() -> None:
    good: dict[str, Any] = {"emd": 0.0, "pairs": 200}
    cells = [
        PAPER,
        cell(C8, 4, "fixed", emd=2.0, **MOVING),
        cell(C8, 64, "fixed", emd=2.0, **MOVING),
        # a still camera, hard lamps, direct light, the paper's network itself, silence
        cell(C8, 4, "fixed", camera="still", **good),
        cell("adaptive", 4, "fixed", soft=False, **good, **MOVING),
        cell("adaptive", 4, "fixed", light="direct", **good, **MOVING),
        cell("paper", 4, "fixed", **good, **MOVING),
        cell("nothing", 4, "fixed", **good, **MOVING),
    ]
    found = claim(cells, "paper")
    assert found.met is False
    assert found.figures.endswith("none of ours does")


def test_rows_that_are_not_there() -> None:
    found = check_claims([cell("plain")])
    assert len(found) == 12
    assert all(c.met is None for c in found)
    assert all(c.figures.startswith("not measured") for c in found)
    assert claim([cell("plain")], "EMD at", "fresh 4").figures == f"not measured: no rows of {C8}"


def test_winners() -> None:
    cells = [
        cell("nothing", 0, "fixed", light="none", emd=1.0, on=0, off=0, pairs=0),
        cell("plain", 4, emd=3.0, pairs=150),
        cell("adaptive", 4, emd=2.0, pairs=120),
        cell("plain", 16, emd=0.5, pairs=190),
        cell("adaptive", 16, emd=0.6, pairs=199),
    ]
    assert winners(cells) == [
        "still, 4 spp fresh: EMD adaptive 2, worse than no events at all (1); F1 plain 0.75",
        "still, 16 spp fresh: EMD plain 0.5; F1 adaptive 0.99",
    ]
