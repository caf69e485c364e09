"""Record a trial as a GIF: the scene, and the events of each camera with the estimated line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evs.emulator.config import SensorConfig
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
from evs.examples.pencil.controller import CAMERAS, Controller
from evs.examples.pencil.environment import PencilExperiment, PencilResult, PencilTrial
from evs.examples.pencil.line_tracker import PrincipalPoint, StickLine
from evs.examples.pencil.stereo import stick_line
from evs.msgs import Observation
from evs.msgs.pictures import INK, U8

WINDOW_MS = 10
"""an image shows the events of this number of past ms"""


def record_gif(path: Path, trial: PencilTrial, tracker: str = "events") -> PencilResult:
    """Play a trial and write it as a GIF, in real time."""
    check_gif_name(path)
    experiment = PencilExperiment(tracker, trial.length_m, trial.delay_ms)
    side = SIDE_PX * FACTOR
    view = experiment.loop.world.add_view(
        "scene", sensor=SensorConfig("dvs128", width=side, height=side)
    )
    words = f"{tracker}; pushed with {trial.push_mns:g} mN s every second"
    every, recent, images = round(1000 / FPS), RecentEvents(WINDOW_MS), list[U8]()

    def watch(observation: Observation, controller: Controller) -> None:
        recent.update(observation.packets)
        if observation.t_us // 1000 % every:
            return
        panels = [scene_panel(view)]
        for k, camera in enumerate(CAMERAS):
            panel = recent.panel(camera)
            if controller.tracker.stick is not None:
                draw_line(panel, stick_line(controller.tracker.stick, k), FACTOR)
            panels.append(panel)
        images.append(compose_image(panels, f"t = {observation.t_us / 1e6:.2f} s   {words}"))

    outcome = experiment.play(trial, watch=watch)
    write_images(path, images)
    return outcome


def draw_line(
    panel: U8, line: StickLine, factor: int, principal_point: PrincipalPoint | None = None
) -> None:
    """Draw a line in ink, from the row of the cup up to the edge of the panel.

    Args:
        panel: (h, w, 3), drawn into.
        line: the line.
        factor: image pixels per sensor pixel.
        principal_point: of the camera.
    """
    principal_point = principal_point or PrincipalPoint()
    rows = np.arange(round((principal_point.y + 0.5) * factor))
    v = principal_point.y - ((rows + 0.5) / factor - 0.5)
    u = line.base + line.slope * v
    columns = np.rint((u + principal_point.x + 0.5) * factor - 0.5).astype(np.intp)
    inside = (columns >= 0) & (columns < panel.shape[1])
    panel[rows[inside], columns[inside]] = INK
