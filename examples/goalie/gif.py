"""Record shots as a GIF: the scene, and the events with the predicted crossing."""

from __future__ import annotations

from pathlib import Path

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
from evs.examples.goalie.controller import Goalkeeper
from evs.examples.goalie.environment import SAVES_M, GoalieExperiment
from evs.examples.goalie.tracker import CENTRE_PX, FOCAL_PX, HEIGHT_M, LOOKS_AT_X_M
from evs.msgs import Observation
from evs.msgs.pictures import INK, U8

SHOTS = 4
SHOWN_MS = 4
"""simulated time from one image to the next; a tenth of real time"""


def record_gif(path: Path, speed_m_s: float, tracker: str = "events", first: int = 0) -> int:
    """Shoot SHOTS balls and write them as a GIF, one after the other.

    Args:
        path: the file.
        speed_m_s: of the ball.
        tracker: one of TRACKERS.
        first: seed of the first shot; the others follow.

    Returns:
        How many are saved.
    """
    check_gif_name(path)
    experiment = GoalieExperiment(tracker)
    side = SIDE_PX * FACTOR
    view = experiment.loop.world.add_view(
        "scene", sensor=SensorConfig("dvs128", width=side, height=side)
    )
    images, saved = list[U8](), 0
    for shot in range(SHOTS):
        recent = RecentEvents(SHOWN_MS)
        words = f"{tracker}: shot {shot + 1} at {speed_m_s:g} m/s, {saved} saved"

        def watch(
            observation: Observation,
            keeper: Goalkeeper,
            recent: RecentEvents = recent,
            words: str = words,
        ) -> None:
            recent.update(observation.packets)
            if observation.t_us // 1000 % SHOWN_MS and not observation.done:
                return
            panel = recent.panel("above")
            crossing = keeper.crossing
            if crossing is not None:
                draw_mark(panel, crossing.y_m)
            images.append(compose_image([scene_panel(view), panel], words))

        saved += experiment.shoot(speed_m_s, first + shot, watch) <= SAVES_M
    write_images(path, images, speed=SHOWN_MS * 1e-3 * FPS)
    return saved


def draw_mark(panel: U8, y_m: float) -> None:
    """Draw a cross in ink where the ball will cross the line x = 0.

    Args:
        panel: (h, w, 3), drawn into.
        y_m: where it crosses.
    """
    column = round((CENTRE_PX - LOOKS_AT_X_M * FOCAL_PX / HEIGHT_M + 0.5) * FACTOR)
    row = round((CENTRE_PX - y_m * FOCAL_PX / HEIGHT_M + 0.5) * FACTOR)
    for step in range(-6, 7):
        for y, x in ((row + step, column + step), (row + step, column - step)):
            if 0 <= y < panel.shape[0] and 0 <= x < panel.shape[1]:
                panel[y, x] = INK
