"""A moving picture of a trial: the scene, and each camera's events with the line it believes in."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evs.drivers.loops.pencil.arena import Arena, Outcome, Trial
from evs.drivers.loops.pencil.controller import CAMERAS, Controller
from evs.drivers.loops.pencil.line import Line, Origin
from evs.drivers.loops.pencil.views import stick_line
from evs.drivers.pictures import U8, Playback, event_frame, suffix_of, to_srgb8, upscale, write_gif
from evs.drivers.pictures.colours import FAINT, INK, PAPER
from evs.drivers.pictures.lettering import legend_line, paste, side_by_side, text_line
from evs.emulator.config import SensorConfig
from evs.msgs import Events, EvsError, Observation, empty_events

SIDE_PX = 128
FACTOR = 2
GAP_PX = 8
LETTER_PX = 15
FPS = 25.0
"""Frames of the picture per second, in real time."""
WINDOW_US = 10_000
"""Events of so long before each frame are shown."""
EXPOSURE = 0.9


def film(path: Path, trial: Trial, tracker: str = "events") -> Outcome:
    """Play a trial and write it as a GIF, in real time."""
    if suffix_of(path) != ".gif":
        raise EvsError(f"'{path}': end it in .gif")
    arena = Arena(tracker, trial.length_m, trial.delay_ms)
    words = f"pushed with {trial.push_mns:g} mN s a second"
    size = SIDE_PX * FACTOR
    view = arena.loop.world.add_view(
        "scene", sensor=SensorConfig("dvs128", width=size, height=size)
    )
    pages: list[U8] = []
    recent: dict[str, list[Events]] = {camera: [] for camera in CAMERAS}
    every, kept = round(1000 / FPS), WINDOW_US // 1000

    def watch(seen: Observation, controller: Controller) -> None:
        for packet in seen.packets:
            recent[packet.camera] = [*recent[packet.camera], packet.events][-kept:]
        if seen.t_us // 1000 % every:
            return
        panels = [np.repeat(to_srgb8(view.render()[0], EXPOSURE)[:, :, np.newaxis], 3, axis=2)]
        stick = controller.tracker.stick
        for k, camera in enumerate(CAMERAS):
            events = np.concatenate([empty_events(), *recent[camera]])
            panel = upscale(event_frame(events, SIDE_PX, SIDE_PX), FACTOR)
            if stick is not None:
                draw_line(panel, stick_line(stick, k), FACTOR)
            panels.append(panel)
        pages.append(_page(panels, f"t = {seen.t_us / 1e6:.2f} s   {words}"))

    outcome = arena.play(trial, watch=watch)
    if not pages:
        raise EvsError(f"{trial.seconds:g} s are too short for a picture: give more")
    playback = Playback(0, len(pages) * round(1e6 / FPS), fps=FPS, speed=1.0)
    write_gif(path, pages, playback)
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


def _page(panels: list[U8], words: str) -> U8:
    side = panels[0].shape[0]
    legend = side_by_side(text_line(words, LETTER_PX), legend_line(LETTER_PX), 2 * LETTER_PX)
    width = max(len(panels) * (side + GAP_PX) - GAP_PX, legend.width) + 2 * GAP_PX
    page = np.full((side + legend.height + 3 * GAP_PX, width, 3), PAPER, np.uint8)
    for k, panel in enumerate(panels):
        left = GAP_PX + k * (side + GAP_PX)
        page[GAP_PX - 1 : GAP_PX + side + 1, left - 1 : left + side + 1] = FAINT
        paste(page, panel, left, GAP_PX)
    paste(page, legend.picture, GAP_PX, side + 2 * GAP_PX)
    return page
