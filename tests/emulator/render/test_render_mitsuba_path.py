"""`path` against Mitsuba 3: soft light and bounces, pixel by pixel within the noise of both.

Each scene is a function of reference/path_stages.py.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from reference.mitsuba_scene import mitsuba_scene, render
from reference.our_light import path_batches
from reference.path_stages import PATH_STAGES, mitsuba_integrator
from reference.pixelwise import assert_same_picture

pytestmark = [pytest.mark.slow, pytest.mark.statistical]
BATCHES = {"embers": 8, "faint_mirror": 8, "room": 8, "sky": 8, "sunset": 8}
"""How many, where 16 are more than it takes to see 1 %."""
SPP = {
    "glass": (256, 256),
    "room": (128, 128),
    "embers": (128, 256),
    "metals": (128, 128),
    "metal_bulb": (128, 128),
}
"""Samples a batch, ours and Mitsuba's, where 64 are too few."""


@cache
def theirs_of(name: str) -> np.ndarray:
    scene = mitsuba_scene(PATH_STAGES[name](), mitsuba_integrator(name))
    return render(scene, BATCHES.get(name, 16), SPP.get(name, (64, 64))[1])


@pytest.mark.parametrize("name", PATH_STAGES)
def test_path_is_mitsubas_light(name: str, pytestconfig: pytest.Config) -> None:
    stage = PATH_STAGES[name]()
    ours = path_batches(stage, BATCHES.get(name, 16), SPP.get(name, (64, 64))[0])
    folder = pytestconfig.rootpath / "out" / "tests"
    assert_same_picture(f"path_{name}", ours, theirs_of(name), folder)


@pytest.mark.parametrize("sampler", ["sobol", "global", "random", "anchored"])
def test_no_sampler_changes_the_light(sampler: str, pytestconfig: pytest.Config) -> None:
    stage = PATH_STAGES["panel"]()
    drawn = replace(stage, render=replace(stage.render, sampler=sampler))
    folder = pytestconfig.rootpath / "out" / "tests"
    ours = path_batches(drawn, 16, 256)
    assert_same_picture(f"path_{sampler}", ours, theirs_of("panel"), folder)


def test_a_bounce_too_few_is_refused(tmp_path: Path) -> None:
    stage = PATH_STAGES["room"]()
    theirs = theirs_of("room")
    ours = path_batches(replace(stage, bounces=stage.bounces - 1), BATCHES["room"], 128)
    with pytest.raises(AssertionError, match="means differ by -"):
        assert_same_picture("bounce", ours, theirs, tmp_path)


def test_two_percent_more_albedo_is_refused_by_path(tmp_path: Path) -> None:
    stage = PATH_STAGES["bulb"]()
    brighter = tuple(
        replace(s, rgba=(*(1.02 ** (1 / 2.4) * (c + 0.055) - 0.055 for c in s.rgba[:3]), 1.0))
        for s in stage.scene.surfaces
    )
    wrong = replace(stage, scene=replace(stage.scene, surfaces=brighter))
    with pytest.raises(AssertionError, match=r"means differ by \+"):
        assert_same_picture("albedo", path_batches(wrong, 16, 64), theirs_of("bulb"), tmp_path)
