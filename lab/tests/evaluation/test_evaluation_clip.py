"""What is filmed for an evaluation: pixels, patch, camera motion, and the hash of all of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.base.scene import CameraPose
from evs.emulator.config import CameraConfig
from evs.msgs import EvsError
from evs_lab.evaluation.clip import (
    Clip,
    busiest_square,
    make_clip,
    patch_pixels,
    spread_pixels,
)
from evs_lab.evaluation.clip_light import LightSpec, light_key
from evs_lab.evaluation.digest import digest
from evs_lab.evaluation.scenes import DEFAULT, FIRST_SEED, HELD_OUT, check_names, scene_setup
from evs_lab.training.settings import DataSettings
from reference.judged import written

SIZE = (64, 48)
TICKS = 5


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("scene"))


def shoot(scene: Path, motion: str = "still", **given: int) -> Clip:
    values = {"sampled": 40, "patch_px": 16, "seed": 0, **given}
    return make_clip(scene_setup(str(scene)), motion, TICKS, size=SIZE, **values)


def test_sampled_pixels_are_different_and_inside() -> None:
    pixels = spread_pixels(SIZE, 500, 3)
    assert pixels.shape == (500, 2)
    assert pixels.dtype == np.int32
    assert len({tuple(pixel) for pixel in pixels.tolist()}) == 500
    assert (pixels >= 0).all()
    assert (pixels < SIZE).all()
    # spread evenly: a quarter of them in each quarter, within 5 sigma of a binomial
    left, top = pixels[:, 0] < 32, pixels[:, 1] < 24
    for part in (left & top, left & ~top, ~left & top, ~left & ~top):
        assert abs(int(part.sum()) - 125) < 5 * np.sqrt(500 * 0.25 * 0.75)
    assert np.array_equal(pixels, spread_pixels(SIZE, 500, 3))
    assert not np.array_equal(pixels, spread_pixels(SIZE, 500, 4))
    assert len(spread_pixels((5, 4), 20, 0)) == 20


def test_the_patch_lies_row_by_row() -> None:
    assert patch_pixels((8, 16), 2).tolist() == [[8, 16], [9, 16], [8, 17], [9, 17]]


def test_the_busiest_square() -> None:
    change = np.zeros((48, 64))
    change[30:34, 50] = 1.0
    change[2, 2] = 1.5
    column, row = busiest_square(change, 16)
    assert column % 8 == row % 8 == 0
    assert column <= 50 < column + 16
    assert row <= 30
    assert row + 16 >= 34
    assert busiest_square(np.zeros((48, 64)), 16) == (0, 0)


def test_motion_of_the_camera(scene: Path) -> None:
    still, pan, slide = (shoot(scene, motion) for motion in ("still", "pan", "slide"))
    poses = [[pose for _, pose in clip.instants] for clip in (still, pan, slide)]
    first = poses[0][0]
    for pose in (poses[1][0], poses[2][0]):
        assert np.array_equal(pose.pos, first.pos)
        assert np.allclose(pose.mat, first.mat, atol=1e-15)
    for pose in poses[0]:
        assert np.array_equal(pose.pos, first.pos)
        assert np.array_equal(pose.mat, first.mat)
    # 170 px/s in the middle of the picture, by the rotation between two poses 1 ms apart
    turn = poses[1][1].mat.reshape(3, 3) @ poses[1][0].mat.reshape(3, 3).T
    angle = np.arccos((np.trace(turn) - 1) / 2)
    assert angle * pan.camera.fx == pytest.approx(0.170, rel=1e-6)
    moved = poses[2][4].pos - first.pos
    assert np.linalg.norm(moved) == pytest.approx(0.5 * 4e-3)
    assert moved @ first.mat.reshape(3, 3)[:, 0] == pytest.approx(0.5 * 4e-3)


def test_the_scene_moves_and_time_runs(scene: Path) -> None:
    clip = shoot(scene)
    assert [snapshot.t_us for snapshot, _ in clip.instants] == [0, 1000, 2000, 3000, 4000]
    first, last = clip.instants[0][0], clip.instants[-1][0]
    assert not np.array_equal(first.geom_mat, last.geom_mat)
    assert clip.soft
    assert len(clip.pixels) == 40 + 16 * 16


def test_the_fingerprint_tells_takes_apart(scene: Path) -> None:
    clip = shoot(scene)
    same = shoot(scene)
    mark = clip.fingerprint(TICKS)
    assert same.fingerprint(TICKS) == mark
    others = [
        clip.fingerprint(TICKS - 1),
        shoot(scene, "pan").fingerprint(TICKS),
        shoot(scene, seed=1).fingerprint(TICKS),
        shoot(scene, sampled=41).fingerprint(TICKS),
        shoot(scene, patch_px=8).fingerprint(TICKS),
        replace(clip, camera=replace(clip.camera, fx=1 + clip.camera.fx)).fingerprint(TICKS),
    ]
    text = scene.read_text()
    brighter = scene.with_name("brighter.xml")
    brighter.write_text(text.replace('rgb1=".8 .8 .8"', 'rgb1=".81 .8 .8"'))
    others.append(shoot(brighter).fingerprint(TICKS))
    assert len({mark, *others}) == 1 + len(others)
    # what changes no light changes no hash
    commented = scene.with_name("commented.xml")
    commented.write_text(text.replace("<worldbody>", "<!-- a remark --><worldbody>"))
    assert shoot(commented).fingerprint(TICKS) == mark


def test_the_key_of_light(scene: Path) -> None:
    clip = shoot(scene)
    spec = LightSpec("path", 4, "fresh", 3)
    key = light_key(clip, "mark", spec, TICKS)
    assert light_key(clip, "mark", spec, TICKS) == key
    others = [
        light_key(clip, "other", spec, TICKS),
        light_key(clip, "mark", spec, TICKS - 1),
        *(
            light_key(clip, "mark", replace(spec, **change), TICKS)
            for change in ({"spp": 8}, {"seeds": "fixed"}, {"seed": 4},
                           {"antialiasing": "adaptive"},
                           {"renderer": "direct", "seeds": "fixed"})
        ),
    ]  # fmt: skip
    assert len({key, *others}) == 1 + len(others)


def test_digests() -> None:
    values = [
        None, True, 1, "1", 1.0, (1,), [1], (1, 2), ((1,), 2), "None", {"a": 1}, {"a": 2},
        np.zeros(2, np.float32), np.zeros(2), np.zeros((2, 1)), np.float32(0), -0.0, 0.0,
        CameraConfig(), CameraConfig(fovy=3.0), CameraPose(np.zeros(3), np.zeros(9)),
    ]  # fmt: skip
    assert len({digest(value) for value in values}) == len(values)
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    with pytest.raises(EvsError, match="object cannot be hashed"):
        digest(object())


def test_procedural_scenes_are_of_seeds_that_training_refuses() -> None:
    with pytest.raises(EvsError, match="seed is"):
        DataSettings(seed=FIRST_SEED)
    DataSettings(seed=FIRST_SEED - 1)
    one, same, other = (
        make_clip(scene_setup(name), "still", TICKS, size=SIZE, sampled=40, patch_px=16)
        for name in ("procedural/0", "procedural/0", "procedural/1")
    )
    marks = [clip.fingerprint(TICKS) for clip in (one, same, other)]
    assert marks[0] == marks[1] != marks[2]
    # something moves from the first picture on, and the camera does not
    assert not np.array_equal(one.instants[0][0].geom_pos, one.instants[-1][0].geom_pos) or (
        not np.array_equal(one.instants[0][0].geom_mat, one.instants[-1][0].geom_mat)
    )
    for _, pose in other.instants:
        assert np.array_equal(pose.mat, other.instants[0][1].mat)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"motion": "pans"}, "no camera motion 'pans'; there is: pan"),
        ({"sampled": 0}, "pixels is 0; give 1 ..."),
        ({"sampled": 64 * 48 + 1}, "pixels is 3073; give"),
        ({"patch_px": 49}, "a patch of 49 px does not fit 64 x 48 px"),
    ],
)
def test_what_cannot_be_filmed(scene: Path, given: dict[str, object], says: str) -> None:
    with pytest.raises(EvsError, match=says.replace(".", r"\.")):
        shoot(scene, **given)  # type: ignore[arg-type]


def test_sets_of_scenes_are_disjoint_and_stand_for_their_scenes() -> None:
    assert not set(DEFAULT) & set(HELD_OUT)
    assert check_names(("held_out", "gymnasium/ant")) == (*HELD_OUT, "gymnasium/ant")
    with pytest.raises(EvsError, match="'gymnasium/ant' is given twice"):
        check_names(("default", "gymnasium/ant"))


@pytest.mark.parametrize("name", [n for n in HELD_OUT if n.startswith("dm_control")])
def test_a_robot_that_is_held_out_has_soft_light_and_a_view_of_its_own(name: str) -> None:
    setup = scene_setup(name)
    assert setup.soft
    assert setup.view.distance > 0
    assert setup.view.lookat is not None
