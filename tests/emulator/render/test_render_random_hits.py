"""Random MJCF against MuJoCo's own rays: which geom, and how far."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from evs.emulator.base.scene import CameraModel
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene

pytestmark = pytest.mark.property

WIDTH, HEIGHT = 96, 72
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}


def random_world(rng: np.random.Generator, decades: float, count: int = 14) -> mujoco.MjModel:
    """Geoms of all shapes, smaller where they are many, two meshes and a floor."""
    meshes, geoms = "", '<geom type="plane" size="0 0 .1" pos="0 0 -1.5"/>'
    for index in range(2):
        points = " ".join(f"{x:.6f}" for x in rng.normal(size=24) * 0.3)
        meshes += f'<mesh name="m{index}" vertex="{points}"/>'
    kinds = [*rng.choice(list(SIZES), count), "mesh", "mesh"]
    for index, kind in enumerate(kinds):
        place = " ".join(f"{x:.6f}" for x in rng.uniform(-1, 1, 3))
        turn = " ".join(f"{x:.6f}" for x in rng.normal(size=4))
        size = 0.25 * (14 / count) ** (1 / 3) * 10 ** rng.uniform(-decades, 0.2, SIZES.get(kind, 0))
        shape = f'mesh="m{index - count}"' if kind == "mesh" else ""
        if len(size):
            shape = f'size="{" ".join(f"{x:.8f}" for x in size)}"'
        geoms += f'<geom type="{kind}" pos="{place}" quat="{turn}" {shape}/>'
    xml = f"<mujoco><asset>{meshes}</asset><worldbody>{geoms}</worldbody></mujoco>"
    return mujoco.MjModel.from_xml_string(xml)


@pytest.mark.parametrize(("decades", "count"), [(0.5, 14), (2.0, 14), (0.5, 1000)])
@pytest.mark.parametrize("seed", range(12))
def test_random_worlds_are_hit_where_mujoco_hits_them(
    seed: int, decades: float, count: int, camera_rays: Callable[[CameraModel], np.ndarray]
) -> None:
    rng = np.random.default_rng(seed)
    model = random_world(rng, decades, count)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    view = CameraConfig(
        lookat=(0, 0, 0), distance=5.0, azimuth=rng.uniform(0, 360), elevation=rng.uniform(-80, 10)
    )
    bound = bind_camera(model, "", WIDTH, HEIGHT, view)
    shot = SnapshotTaker(model, [bound]).snapshot(data, 0)
    pose, camera, scene = shot.cameras[0], bound.model, extract_scene(model)
    index, distance = NativeRenderer(scene, camera, RenderConfig(spp=1), 1).hits(shot, pose)

    d = camera_rays(camera).reshape(-1, 3) @ pose.mat.reshape(3, 3).T
    theirs, depth = np.zeros(len(d), np.int32), np.zeros(len(d))
    mujoco.mj_multiRay(
        model, data, pose.pos, np.ascontiguousarray(d).reshape(-1), None, 1, -1, theirs, depth,
        np.zeros(3 * len(d)), len(d), mujoco.mjMAXVAL,
    )  # fmt: skip
    theirs, depth = theirs.reshape(HEIGHT, WIDTH), depth.reshape(HEIGHT, WIDTH)
    ours = np.where(index >= 0, scene.geom_id[index], -1)

    # a pixel in which every ray near by hits the same geom
    calm = np.zeros((HEIGHT, WIDTH), bool)
    windows = np.lib.stride_tricks.sliding_window_view(theirs, (3, 3))
    calm[1:-1, 1:-1] = (windows == windows[..., 1:2, 1:2]).all((-1, -2))
    assert calm.mean() > (0.5 if count < 1000 else 0.2)
    np.testing.assert_array_equal(ours[calm], theirs[calm])
    seen = calm & (theirs >= 0)
    np.testing.assert_allclose(distance[seen], depth[seen], rtol=1e-4)
    # and elsewhere single pixels only
    assert np.mean(ours == theirs) > 0.995
