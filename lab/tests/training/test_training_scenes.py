"""Training scenes: they follow from the seed alone, they load, they move as fast as was asked."""

from __future__ import annotations

import builtins
import io
import os
import re
from collections import Counter

import numpy as np
import pytest

from evs.emulator.world import bytes_of
from evs_lab.training.pilot import run_pilot
from evs_lab.training.scenes import KINDS, make_scene
from evs_lab.training.scenes.draft import Draft, encoded, num
from evs_lab.training.scenes.materials import PATTERNS, albedo, pattern_file
from evs_lab.training.scenes.motion import Eye, moving
from evs_lab.training.scenes.scene import TrainingScene
from evs_lab.training.traced_scene import load_scene, simulate_scene

MANY = 100


@pytest.fixture(scope="module")
def scenes() -> list[TrainingScene]:
    return [make_scene(1, number) for number in range(MANY)]


def test_a_scene_follows_from_seed_and_number(scenes: list[TrainingScene]) -> None:
    # made on its own and in another order, it is the same
    for number in (17, 3):
        again = make_scene(1, number)
        assert again == scenes[number]
        assert again.digest == scenes[number].digest
    others = [make_scene(2, 3), make_scene(1, 3, attempt=1)]
    assert len({scene.digest for scene in [*scenes, *others]}) == MANY + 2


def test_nothing_is_read_for_a_scene(
    scenes: list[TrainingScene], monkeypatch: pytest.MonkeyPatch
) -> None:
    # gymnasium's and dm_control's robots are test scenes: they cannot come in through a file
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a file was opened")

    for module, name in ((builtins, "open"), (io, "open"), (os, "open"), (os, "listdir")):
        monkeypatch.setattr(module, name, refuse)
    again = [make_scene(1, number) for number in range(5)]
    monkeypatch.undo()
    assert again == scenes[:5]
    for scene in scenes:
        assert "<include" not in scene.text
        assert set(re.findall(r'file="([^"]*)"', scene.text)) == set(scene.files)


def test_of_five_in_a_row_each_is_of_another_kind(scenes: list[TrainingScene]) -> None:
    kinds = [scene.meta["kind"] for scene in scenes]
    assert all(set(kinds[k : k + 5]) == set(KINDS) for k in range(0, MANY, 5))
    # and not always in one order
    assert len({tuple(kinds[k : k + 5]) for k in range(0, MANY, 5)}) > 10


def test_the_scenes_have_what_an_event_camera_meets(scenes: list[TrainingScene]) -> None:
    tags = Counter(tag for scene in scenes for tag in scene.meta["tags"])
    for tag in (
        *("mirror", "metal", "physical", "glow", "sky", "fine", "textured", "night", "falling"),
        *("soft shadows", "hard shadows", "swinging lamp", "flicker mains", "flicker pwm"),
        *("flicker sine", "camera still", "camera pan", "camera slide", "camera shake"),
        *("drift", "spin", "wag", "orbit", "tumble", "plane", "ball", "drum", "hills", "hull"),
    ):
        assert tags[tag] >= 1, tag
    # no one recipe dominates
    assert 0.2 * MANY < tags["camera still"] < 0.6 * MANY
    levels = np.array([scene.meta["level"] for scene in scenes])
    assert levels.min() < 0.02
    assert levels.max() > 10
    speeds = np.concatenate([scene.meta["speeds_asked_px_s"] for scene in scenes])
    assert speeds.min() >= 0.1
    assert speeds.max() <= 5000
    assert np.quantile(speeds, 0.15) < 10 < 300 < np.quantile(speeds, 0.85)


def test_no_spring_is_too_stiff_for_the_ticks(scenes: list[TrainingScene]) -> None:
    # a swing of w rad/s flies apart at w dt = 2; 0.3 of it is followed well
    springs = [float(k) for s in scenes for k in re.findall(r'stiffness="([^"]*)"', s.text)]
    assert len(springs) > 20
    assert 0 < min(springs) < max(springs) <= (0.3 / 1e-3) ** 2


def test_albedo_goes_over_three_decades() -> None:
    draft = Draft(np.random.default_rng(1))
    drawn = np.array([albedo(draft) for _ in range(4000)])
    assert 1e-3 <= drawn.min() < 2e-3
    assert 0.9 < drawn.max() < 1
    assert encoded(0.0) == 0
    assert encoded(1.0) == pytest.approx(1.0)
    assert encoded(0.2140411) == pytest.approx(0.5, abs=1e-6)


def test_every_pattern_is_a_picture_with_the_contrast_asked_for() -> None:
    from PIL import Image

    draft = Draft(np.random.default_rng(3))
    seen = Counter()
    for _ in range(60):
        name, kind = pattern_file(draft, contrast=10.0)
        picture = np.array(Image.open(io.BytesIO(draft.files[name])))
        assert picture.dtype == np.uint8
        assert picture.shape in {(side, side, 3) for side in (32, 64, 128, 256)}
        # green, whatever the tint: never below half of 1 / contrast
        assert picture.min() >= np.floor(255 / 10 / 2)
        assert picture.std() > 1
        seen[kind] += 1
    assert set(seen) == set(PATTERNS)


def test_scenes_load_and_hold_together(scenes: list[TrainingScene]) -> None:
    for scene in scenes[:40]:
        traced = simulate_scene(scene, 3, 1000, 1)
        assert len(traced.snapshots) == 3
        assert (traced.camera.width, traced.camera.height) == (346, 260)
        assert not traced.scene.left_out
        assert [snapshot.t_us for snapshot in traced.snapshots] == [0, 1000, 2000]


def test_a_scene_is_the_same_model_whenever_it_is_made(scenes: list[TrainingScene]) -> None:
    """To the last byte, so that what was measured of it is known again."""
    textured = next(scene for scene in scenes if scene.files)
    first, second = (load_scene(textured) for _ in range(2))
    assert bytes_of(first) == bytes_of(second)


@pytest.mark.parametrize("speed", [0.5, 30.0, 1500.0])
@pytest.mark.parametrize("way", ["drift", "spin"])
def test_things_move_as_fast_as_was_asked(way: str, speed: float) -> None:
    found = []
    for seed in range(12):
        draft = Draft(np.random.default_rng([seed, 5]))
        eye = Eye(np.zeros(3), np.array([2.0, 0.0, 0.0]), 45.0)
        ball = '<geom type="sphere" size=".4"/>'
        body = moving(draft, eye, np.array([2.0, 0.0, 0.0]), ball, 0.4, speed)
        if way not in draft.tags:
            continue
        right, up, _ = eye.axes()
        text = (
            '<mujoco><option gravity="0 0 0" timestep=".001"/><worldbody>'
            f'{body}<camera name="eye" fovy="45" xyaxes="{num(*right, *up)}"/></worldbody>'
            f'<keyframe><key name="start" qvel="{num(*draft.velocity)}"/></keyframe></mujoco>'
        )
        pilot = run_pilot(simulate_scene(TrainingScene(text, {}, (), 1, {}), 20, 1000, 1), 0)
        # its fastest part, in the first ms
        found.append(float(np.nanmax(pilot.speed[0])) / speed)
    assert len(found) >= 2
    assert all(0.3 < share < 2.0 for share in found), found
