"""Record a trial as a GIF: the robot, and the events of its camera with the estimated pole."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evs.emulator.config import CameraConfig, SensorConfig
from evs.examples.cartpole.controller import CartPoleController
from evs.examples.cartpole.environment import CartPoleLoop, CartPoleResult, CartPoleTrial, play
from evs.examples.cartpole.tracker import CameraMount
from evs.examples.common.gif import (
    FACTOR,
    FPS,
    SIDE_PX,
    RecentEvents,
    check_gif_name,
    compose_image,
    scene_panel,
    write_images,
)
from evs.msgs import Observation
from evs.msgs.pictures import INK, U8

WINDOW_TICKS = 10
"""an image shows the events of this number of past ticks"""


def record_gif(path: Path, trial: CartPoleTrial) -> CartPoleResult:
    """Play a trial and write it as a GIF, in real time."""
    check_gif_name(path)
    loop = CartPoleLoop(delay_ms=trial.delay_ms)
    side = SIDE_PX * FACTOR
    viewpoint = CameraConfig(lookat=(0.0, 0.0, 0.25), distance=2.6, azimuth=80.0, elevation=-8.0)
    size = SensorConfig("dvs128", width=3 * side // 2, height=side)
    view = loop.world.add_view(viewpoint, sensor=size)
    images, recent, every = list[U8](), RecentEvents(WINDOW_TICKS), round(1000 / FPS)
    words = f"pushed with {trial.push_ns:g} N s every 2 s"

    def watch(observation: Observation, controller: CartPoleController) -> None:
        recent.update(observation.packets)
        if observation.t_us // 1000 % every:
            return
        panel = recent.panel(loop.world.cameras[0].name)
        draw_pole(panel, controller.angle)
        images.append(
            compose_image(
                [scene_panel(view), panel], f"t = {observation.t_us / 1e6:.2f} s   {words}"
            )
        )

    outcome = play(loop, trial, watch)
    write_images(path, images)
    return outcome


def draw_pole(panel: U8, angle_rad: float) -> None:
    """Draw the axis of the pole in ink.

    Args:
        panel: (h, w, 3), drawn into.
        angle_rad: angle of the pole.
    """
    mount = CameraMount()
    side = panel.shape[0]
    m_per_px = 2.0 * mount.distance_m * np.tan(np.radians(mount.fovy_deg) / 2.0) / side
    along = np.linspace(0.1, 0.6, 4 * side)
    columns = np.rint(side / 2 + along * np.sin(angle_rad) / m_per_px - 0.5).astype(np.intp)
    up = along * np.cos(angle_rad) - mount.height_m
    rows = np.rint(side / 2 - up / m_per_px - 0.5).astype(np.intp)
    inside = (columns >= 0) & (columns < side) & (rows >= 0) & (rows < side)
    panel[rows[inside], columns[inside]] = INK
