"""A film of a scene before a hand-held camera: it pans slowly and circles with a small radius."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from evs.emulator.base.scene import F32, CameraPose
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import make_renderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene

SCENES = Path(__file__).parents[4] / "config/scenes/dataset"
TICK_US = 1000
CIRCLE_HZ = 2.0


def hand_held(
    scene: str,
    size: tuple[int, int],
    ticks: int,
    render: RenderConfig,
    seed: int,
    pan_px_s: float,
    circle_px: float,
) -> Iterator[F32]:
    """Light of a scene of the data set at 0, 1 ... ms.

    Args:
        scene: its name; its camera is `eye`.
        size: (width, height), px
        ticks: of 1 ms; there is one frame more
        render: how the light is traced
        seed: of its samples
        pan_px_s: to the side; the view is straight ahead at 0.4 s
        circle_px: radius; two circles a second

    Yields:
        (height, width) luminance, a copy.
    """
    model = mujoco.MjModel.from_xml_path(str(SCENES / f"{scene}.xml"))
    model.opt.timestep = 1e-6 * TICK_US
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bound = bind_camera(model, "eye", *size, CameraConfig())
    taker = SnapshotTaker(model, [bound])
    renderer = make_renderer(extract_scene(model), bound.model, render, 2, seed=seed)
    first = taker.snapshot(data, 0).cameras[0]
    for k in range(ticks + 1):
        t_s = 1e-6 * TICK_US * k
        turn = 2 * np.pi * CIRCLE_HZ * t_s
        yaw = (pan_px_s * (t_s - 0.4) + circle_px * np.cos(turn)) / bound.model.fx
        pitch = circle_px * np.sin(turn) / bound.model.fx
        across = np.array([
            [np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]
        ])  # fmt: skip
        up = np.array([
            [1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]
        ])  # fmt: skip
        mat = np.ascontiguousarray((first.mat.reshape(3, 3) @ across @ up).reshape(9))
        snapshot = taker.snapshot(data, TICK_US * k)
        yield renderer.render(snapshot, CameraPose(first.pos, mat)).copy()
        mujoco.mj_step(model, data)
