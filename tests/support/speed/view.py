"""What is timed: a robot, the camera that sees it, and the ways to look at it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from evs.emulator import _core
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import CameraModel, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene

WIDTH, HEIGHT = 346, 260
WIDE = [isa for isa in ("avx512", "avx2", "neon") if isa in _core.isa_available()]
"""The wide instruction sets of this machine: a table has each of them."""
FRAME = f"{WIDTH}x{HEIGHT}, full frame with shadows"
SCENES = [
    "gymnasium/humanoid",
    "dm_control/humanoid",
    "dm_control/cartpole",
    "dm_control/quadruped",
]
PRIMITIVES = SCENES[:3]
"""Those without a mesh or a height field."""
AZIMUTH, ELEVATION = 90.0, -20.0
CONTROL_TICKS = 10
Rays = Callable[[CameraModel], np.ndarray]
"""The rays through a camera's pixels, in its frame: (h, w, 3)."""


@dataclass(frozen=True)
class View:
    """A model at one instant, seen by a camera."""

    model: mujoco.MjModel
    data: mujoco.MjData
    content: SceneModel
    shot: SceneSnapshot
    camera: CameraModel
    pose: CameraPose

    def light(
        self, threads: int, spp: int = 1, switches: Switches = UNFORCED, **render: str
    ) -> Callable[[], np.ndarray]:
        """A call that traces the full frame."""
        config = RenderConfig(  # type: ignore[arg-type]
            **{"antialiasing": "fixed", **render}, spp=spp, incremental=False, sites=False
        )
        renderer = make_renderer(self.content, self.camera, config, threads, switches=switches)
        return lambda: renderer.render(self.shot, self.pose)

    def multi_ray(self, camera_rays: Rays) -> Callable[[], np.ndarray]:
        """A call of MuJoCo's own ray casting, for the same pixels: the nearest geom of each."""
        rays = camera_rays(self.camera).reshape(-1, 3) @ self.pose.mat.reshape(3, 3).T
        flat = np.ascontiguousarray(rays).ravel()
        ids, depth = np.zeros(len(rays), np.int32), np.zeros(len(rays))
        # those that are shown
        groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)

        def cast() -> np.ndarray:
            mujoco.mj_multiRay(
                self.model, self.data, self.pose.pos, flat, groups, 1, -1, ids, depth, None,
                len(ids), 1e10,
            )  # fmt: skip
            return ids.reshape(self.camera.height, self.camera.width)

        return cast


def free_camera(model: mujoco.MjModel) -> CameraConfig:
    """MuJoCo's default free camera, turned to stand beside the robot."""
    x, y, z = model.stat.center
    return CameraConfig(
        lookat=(x, y, z),
        distance=1.5 * model.stat.extent,
        azimuth=AZIMUTH,
        elevation=ELEVATION,
    )


def view_of(model: mujoco.MjModel, data: mujoco.MjData, camera: str = "") -> View:
    """As it is; without a camera's name by a free one."""
    mujoco.mj_forward(model, data)
    bound = bind_camera(
        model, camera, WIDTH, HEIGHT, CameraConfig() if camera else free_camera(model)
    )
    shot = SnapshotTaker(model, [bound]).snapshot(data, 0)
    return View(model, data, extract_scene(model), shot, bound.model, shot.cameras[0])


def robot(path: Path) -> View:
    """The robot of a file after 20 ms."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    for _ in range(20):
        mujoco.mj_step(model, data)
    return view_of(model, data)


def film(view: View, ticks: int) -> list[SceneSnapshot]:
    """The first tick and `ticks` more of 1 ms, under new random controls every 10 ms."""
    model, data = view.model, view.data
    poser = SnapshotTaker(model, [bind_camera(model, "", WIDTH, HEIGHT, free_camera(model))])
    rng = np.random.default_rng(1)
    shots = []
    for k in range(ticks + 1):
        shots.append(poser.snapshot(data, 1000 * k))
        if k % CONTROL_TICKS == 0:
            data.ctrl[:] = rng.uniform(-0.4, 0.4, model.nu)
        mujoco.mj_step(model, data)
    return shots


def share_of_the_same_geoms(view: View, camera_rays: Rays) -> float:
    """Of the pixels: where both find the same, a geom or nothing."""
    renderer = NativeRenderer(view.content, view.camera, RenderConfig(sites=False), 1)
    index, _ = renderer.hits(view.shot, view.pose)
    ours = np.where(index < 0, -1, view.content.geom_id[index])
    return float((ours == view.multi_ray(camera_rays)()).mean())
