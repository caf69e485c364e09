"""`direct` against Mitsuba 3: hard lights, shadows and Lambert surfaces, pixel by pixel.

Each scene is a function of reference/direct_stages.py. The test of the test: what is 2 % off in
brightness, or wrong in one pixel, is refused.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference.direct_stages import DIRECT_STAGES
from reference.mitsuba_scene import mitsuba_scene, render
from reference.our_light import direct_batches
from reference.pixelwise import SIGNIFICANCE, assert_same_picture, judge
from reference.stage import Stage

pytestmark = [pytest.mark.slow, pytest.mark.statistical]
BATCHES, SPP = 16, 64


def theirs_of(stage: Stage) -> np.ndarray:
    """Without any light off other surfaces."""
    return render(mitsuba_scene(stage, "path"), BATCHES, SPP)


@pytest.mark.parametrize("name", DIRECT_STAGES)
def test_direct_is_mitsubas_light(name: str, pytestconfig: pytest.Config) -> None:
    stage = DIRECT_STAGES[name]()
    folder = pytestconfig.rootpath / "out" / "tests"
    assert_same_picture(f"direct_{name}", direct_batches(stage, BATCHES), theirs_of(stage), folder)


def test_two_percent_more_albedo_is_refused(tmp_path: Path) -> None:
    stage = DIRECT_STAGES["point"]()
    brighter = tuple(
        replace(s, rgba=(*(1.02 ** (1 / 2.4) * (c + 0.055) - 0.055 for c in s.rgba[:3]), 1.0))
        for s in stage.scene.surfaces
    )
    wrong = replace(stage, scene=replace(stage.scene, surfaces=brighter))
    theirs = theirs_of(stage)
    with pytest.raises(AssertionError, match=r"means differ by \+(1.9|2.0).*see .*wrong"):
        assert_same_picture("wrong", direct_batches(wrong, BATCHES), theirs, tmp_path)
    # and the pictures are there
    assert {path.name for path in tmp_path.iterdir()} == {
        *("wrong_ours.png", "wrong_theirs.png", "wrong_z.png", "wrong.npz"),
    }
    with np.load(tmp_path / "wrong.npz") as saved:
        np.testing.assert_array_equal(saved["theirs"], theirs)


def test_a_shadow_that_is_a_centimetre_off_is_refused(tmp_path: Path) -> None:
    stage = DIRECT_STAGES["spot"]()
    moved = stage.shot.geom_pos + np.array([[0, 0, 0], [0.01, 0, 0]])
    wrong = replace(stage, shot=replace(stage.shot, geom_pos=moved))
    with pytest.raises(AssertionError, match="px block"):
        assert_same_picture("moved", direct_batches(wrong, BATCHES), theirs_of(stage), tmp_path)


def test_one_wrong_pixel_is_refused(tmp_path: Path) -> None:
    stage = DIRECT_STAGES["directional"]()
    ours, theirs = direct_batches(stage, BATCHES), theirs_of(stage)
    ours[:, 20, 5] *= 1.005
    with pytest.raises(AssertionError, match=r"1 px block \(row 20, column 5\)"):
        assert_same_picture("pixel", ours, theirs, tmp_path)
    ours[3, 20, 5] = np.nan
    with pytest.raises(AssertionError, match="not a number"):
        judge(ours, theirs)


def test_noise_that_would_hide_a_percent_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    a, b = (1 + 3 * rng.normal(size=(16, 24, 24)) for _ in range(2))
    with pytest.raises(AssertionError, match="too noisy"):
        assert_same_picture("noise", a, b, tmp_path)


def test_the_judge_keeps_its_word_on_equal_pictures() -> None:
    # 300 comparisons of one picture with itself, in normal noise of the pixel's own width
    rng = np.random.default_rng(1)
    light = rng.uniform(0.1, 1, (24, 36))
    width = light * rng.uniform(0.01, 0.3, light.shape)
    p = np.array(
        [
            judge(*(light + width * rng.normal(size=(n, *light.shape)) for n in (16, 12))).p
            for _ in range(300)
        ]
    )
    # p is uniform or larger (blocks depend on their pixels): 15 below .05, sd 3.8
    assert (p < 0.05).sum() <= 15 + 4 * 3.8
    assert (p < 0.05).sum() >= 1
    assert p.min() > SIGNIFICANCE / 10
