"""trace(pixels): any list of pixels, with the light that a whole frame gives them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene
from reference.instants import Film

WIDTH, HEIGHT = 97, 61


def stage(path: Path, isa: str = "auto", spp: int = 3):
    """(renderer, snapshot, pose) of a robot a little after the start."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    for _ in range(30):
        mujoco.mj_step(model, data)
    view = CameraConfig(azimuth=80, elevation=-20)
    bound = bind_camera(model, "", WIDTH, HEIGHT, view)
    snapshot = SnapshotTaker(model, [bound]).snapshot(data, 0)
    config = RenderConfig(spp=spp, isa=isa)
    renderer = NativeRenderer(extract_scene(model), bound.model, config, 2)
    return renderer, snapshot, snapshot.cameras[0]


@pytest.mark.parametrize("isa", _core.isa_available())
@pytest.mark.parametrize("name", ["gymnasium/humanoid", "gymnasium/reacher", "dm_control/dog"])
def test_pixels_have_the_frames_light(name: str, isa: str, robot_files: dict[str, Path]) -> None:
    renderer, snapshot, pose = stage(robot_files[name], isa)
    frame = renderer.render(snapshot, pose).copy()
    rng = np.random.default_rng(3)
    # scattered, repeated, and a number that fills no packet
    pixels = np.stack([rng.integers(0, WIDTH, 1003), rng.integers(0, HEIGHT, 1003)], 1)
    light = renderer.trace(snapshot, pose, pixels)
    np.testing.assert_array_equal(light, frame[pixels[:, 1], pixels[:, 0]])
    # the frame that is kept was not touched
    np.testing.assert_array_equal(renderer.render(snapshot, pose), frame)
    assert renderer.traced_fraction == 0


def test_none_one_and_outside(robot_files: dict[str, Path]) -> None:
    renderer, snapshot, pose = stage(robot_files["gymnasium/ant"], spp=1)
    assert len(renderer.trace(snapshot, pose, np.zeros((0, 2), np.int32))) == 0
    corner = renderer.trace(snapshot, pose, np.array([[WIDTH - 1, HEIGHT - 1]], np.int32))
    assert corner[0] == renderer.render(snapshot, pose)[-1, -1]
    for outside in ((-1, 0), (0, -1), (WIDTH, 0), (0, HEIGHT)):
        with pytest.raises(ValueError, match="outside the image"):
            renderer.trace(snapshot, pose, np.array([outside], np.int32))


def test_a_moved_scene_is_traced_where_it_is(robot_files: dict[str, Path]) -> None:
    # pixels of a later snapshot, without and then with a frame in between
    model = mujoco.MjModel.from_xml_path(str(robot_files["dm_control/dog"]))
    model.opt.timestep = 1e-3
    film = Film(model, (WIDTH, HEIGHT), CameraConfig(azimuth=80, elevation=-20))
    renderer = film.renderer()
    everywhere = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    for snapshot in film.snapshots(81)[20::20]:
        pose = snapshot.cameras[0]
        traced = renderer.trace(snapshot, pose, everywhere).reshape(HEIGHT, WIDTH)
        np.testing.assert_array_equal(renderer.render(snapshot, pose), traced)
