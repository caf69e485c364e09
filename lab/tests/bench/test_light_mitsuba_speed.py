"""Time of a sample beside Mitsuba 3, compiled by LLVM, on the same content in the same run.

Without the quadruped: of its two lamps Mitsuba's `direct` asks one at random, ours both.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from speed.elsewhere import AbsentError, Elsewhere
from speed.mitsuba_llvm import BOUNCES, SAMPLES, common_view, mitsuba
from speed.turns import Calls, Table, Time, milliseconds, target
from speed.view import FRAME, PRIMITIVES, View, robot

SAME = 0.01
"""Relative: with SAMPLES samples a pixel of noise, the mean light of a picture is known better."""
LUMINANCE = [0.2126, 0.7152, 0.0722]


def rows_of(name: str, samples: int) -> tuple[str, str]:
    """Mitsuba's row and ours."""
    share = "1 sample" if samples == 1 else f"1 of {samples} samples"
    return f"Mitsuba {name}, {share}", f"{name}, {share}"


def calls_of(view: View, theirs: Elsewhere, threads: int) -> Calls:
    calls: Calls = {}
    for name in ("direct", "path"):
        for samples in (1, SAMPLES):
            light = view.light(threads, samples, renderer=name)
            picture = theirs.call(name, samples) @ LUMINANCE
            np.testing.assert_allclose(picture.mean(), light().mean(), rtol=SAME)
            their_row, our_row = rows_of(name, samples)
            calls[their_row] = lambda name=name, samples=samples: theirs.run(name, samples)
            calls[our_row] = light
    return calls


def times_of(view: View, threads: int) -> dict[str, Time]:
    """Of one sample a pixel."""
    with mitsuba(view, threads) as theirs:
        times = milliseconds(calls_of(view, theirs, threads), rounds=9)
    return {row: time / (SAMPLES if "1 of" in row else 1) for row, time in times.items()}


@pytest.mark.bench
@pytest.mark.parametrize("threads", [1, 2])
def test_samples_beside_mitsuba(threads: int, robot_files: dict[str, Path]) -> None:
    views = {scene: common_view(robot(robot_files[scene])) for scene in PRIMITIVES}
    try:
        columns = {scene: times_of(view, threads) for scene, view in views.items()}
    except AbsentError as absent:
        print(f"\nbeside Mitsuba: {absent}")
        return
    title = (
        f"beside Mitsuba 3 (llvm_ad_rgb), {FRAME}, matt single colours; path: {BOUNCES} bounces; "
        f"a sample a pixel; threads of each: {threads}"
    )
    pairs = [rows_of(name, n) for name in ("direct", "path") for n in (1, SAMPLES)]
    print(table := Table(title, columns, {ours: theirs for theirs, ours in pairs}))
    humanoid = PRIMITIVES[1]
    for _, ours in pairs[:2]:
        print(target(f"{ours}, {humanoid}", table.ratio(humanoid, ours), 5, "x"))
