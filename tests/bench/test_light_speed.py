"""Time of a traced frame beside MuJoCo's own ray casting of the same pixels in the same run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.light import make_renderer
from evs.emulator.scene import CameraModel
from evs.emulator.world import Poser, bind_camera, extract_scene

WIDTH, HEIGHT, ROUNDS = 346, 260, 15
SCENES = [
    "gymnasium/humanoid",
    "dm_control/humanoid",
    "dm_control/cartpole",
    "dm_control/quadruped",
]


def milliseconds(calls: dict[str, Callable[[], object]]) -> dict[str, tuple[float, float, float]]:
    """Median and quartiles of each call; the calls take turns, so drift cancels."""
    samples: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            samples[name].append(1e3 * (time.perf_counter() - begin))
    return {
        name: (statistics.median(s), *np.quantile(s, (0.25, 0.75)).tolist())
        for name, s in samples.items()
    }


@pytest.mark.bench
@pytest.mark.parametrize("scene", SCENES)
def test_direct_against_mujoco_rays(
    scene: str, robot_files: dict[str, Path], camera_rays: Callable[[CameraModel], np.ndarray]
) -> None:
    model = mujoco.MjModel.from_xml_path(str(robot_files[scene]))
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    for _ in range(20):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    bound = bind_camera(model, "", WIDTH, HEIGHT, CameraConfig(azimuth=90, elevation=-20))
    snapshot = Poser(model, [bound]).snapshot(data, 0)
    pose, camera = snapshot.cameras[0], bound.model
    rays = camera_rays(camera).reshape(-1, 3) @ pose.mat.reshape(3, 3).T
    world_rays = np.ascontiguousarray(rays).ravel()
    ids, depth = np.zeros(WIDTH * HEIGHT, np.int32), np.zeros(WIDTH * HEIGHT)

    def multi_ray() -> None:
        mujoco.mj_multiRay(
            model, data, pose.pos, world_rays, None, 1, -1, ids, depth, None, len(ids), 1e10
        )

    content = extract_scene(model)

    def light(threads: int, spp: int, **render: str) -> Callable[[], object]:
        config = RenderConfig(spp=spp, incremental=False, **render)  # type: ignore[arg-type]
        renderer = make_renderer(content, camera, config, threads)
        return lambda: renderer.render(snapshot, pose)

    times = milliseconds({
        "mj_multiRay, primary rays": multi_ray,
        "direct, 1 spp, 1 thread": light(1, 1),
        "direct, 1 spp, 2 threads": light(2, 1),
        "direct, 4 spp, 1 thread": light(1, 4),
        "direct, 4 spp, 2 threads": light(2, 4),
        "adaptive, 4 spp, 1 thread": light(1, 4, antialiasing="adaptive"),
        "adaptive, 16 spp, 1 thread": light(1, 16, antialiasing="adaptive"),
        "path, 1 spp, 1 thread": light(1, 1, renderer="path"),
        "path, 4 spp, 2 threads": light(2, 4, renderer="path"),
    })  # fmt: skip
    yardstick = times["mj_multiRay, primary rays"][0]
    print(f"\n{scene}, {WIDTH}x{HEIGHT}, shadows, full frame")
    for name, (median, low, high) in times.items():
        print(f"  {name:26} {median:7.2f} ms ({low:.2f} - {high:.2f})  {yardstick / median:6.1f}x")
    assert min(median for median, _, _ in times.values()) > 0
