"""A moving picture of a trial: the scene, and each camera's events with the line it believes in."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evs.drivers.pictures import U8, to_srgb8
from evs.drivers.pictures.colours import INK
from evs.emulator.config import SensorConfig
from evs.examples.filming import (
    EXPOSURE,
    FACTOR,
    FPS,
    SIDE_PX,
    Recent,
    check_film,
    page,
    write_film,
)
from evs.examples.pencil.arena import Arena, Outcome, Trial
from evs.examples.pencil.controller import CAMERAS, Controller
from evs.examples.pencil.line import Line, Origin
from evs.examples.pencil.views import stick_line
from evs.msgs import Observation

WINDOW_MS = 10
"""Events of so long before each picture are shown."""


def film(path: Path, trial: Trial, tracker: str = "events") -> Outcome:
    """Play a trial and write it as a GIF, in real time."""
    check_film(path)
    arena = Arena(tracker, trial.length_m, trial.delay_ms)
    side = SIDE_PX * FACTOR
    view = arena.loop.world.add_view(
        "scene", sensor=SensorConfig("dvs128", width=side, height=side)
    )
    words = f"{tracker}; pushed with {trial.push_mns:g} mN s every second"
    every, recent, pages = round(1000 / FPS), Recent(WINDOW_MS), list[U8]()

    def watch(seen: Observation, controller: Controller) -> None:
        recent.see(seen.packets)
        if seen.t_us // 1000 % every:
            return
        scene = to_srgb8(view.render()[0], EXPOSURE)
        panels = [np.repeat(scene[:, :, np.newaxis], 3, axis=2)]
        for k, camera in enumerate(CAMERAS):
            panel = recent.panel(camera)
            if controller.tracker.stick is not None:
                draw_line(panel, stick_line(controller.tracker.stick, k), FACTOR)
            panels.append(panel)
        pages.append(page(panels, f"t = {seen.t_us / 1e6:.2f} s   {words}"))

    outcome = arena.play(trial, watch=watch)
    write_film(path, pages)
    return outcome


def draw_line(panel: U8, line: Line, factor: int, origin: Origin | None = None) -> None:
    """In ink, from the row of the cup up to the panel's edge. In: panel (h, w, 3), drawn into."""
    origin = origin or Origin()
    rows = np.arange(round((origin.y + 0.5) * factor))
    v = origin.y - ((rows + 0.5) / factor - 0.5)
    u = line.base + line.slope * v
    columns = np.rint((u + origin.x + 0.5) * factor - 0.5).astype(np.intp)
    inside = (columns >= 0) & (columns < panel.shape[1])
    panel[rows[inside], columns[inside]] = INK
