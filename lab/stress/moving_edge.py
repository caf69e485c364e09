"""An edge that moves at a known speed: each pixel's events and their times in closed form.

A bright half plane moves over a dim one to the right, seen without perspective, a pixel a metre.
A pixel's light follows the share of it that the edge has passed, so its n-th event is due when
ln(1 + share (bright / dim - 1)) = n thresholds.
"""

from __future__ import annotations

import math

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F64
from evs.emulator.world import ORTHOGRAPHIC
from evs_lab.stress.capture import Capture, capture
from evs_lab.stress.closed_form import THETA, residual_thresholds
from evs_lab.stress.grid_target import HEIGHT_PX

DIM, BRIGHT = 0.1, 0.55
EVENTS = math.floor(math.log(BRIGHT / DIM) / THETA)
"""of each pixel that the edge passes: 8"""

SPP = 64
"""samples a pixel, each in a column of its own, so the share is right to 1/64 of a pixel"""

FIRST_PX = -0.1
"""where the edge begins: a little outside the picture"""

SCENE = f"""<mujoco><option timestep="1000"/><visual><headlight active="0"/></visual>
<asset><material name="dim" rgba="1 1 1 1" emission="{DIM}"/>
<material name="bright" rgba="1 1 1 1" emission="{BRIGHT}"/></asset><worldbody>
<camera name="eye" pos="0 0 9" {ORTHOGRAPHIC} fovy="{HEIGHT_PX}"/>
<geom type="box" size="99 99 .1" material="dim"/><body name="edge" mocap="true">
<geom type="box" size="50 99 .1" pos="-50 0 1" material="bright"/></body></worldbody></mujoco>"""


def capture_edge(speed_px_s: float, tick_us: int, width_px: int) -> Capture:
    """Move the edge through the picture, wait two ticks, and put it back at once."""
    tick_s = tick_us * 1e-6
    ticks = math.ceil((width_px - FIRST_PX) / speed_px_s / tick_s) + 4

    def act(tick: int, world: World) -> None:
        at_px = min(FIRST_PX + speed_px_s * tick * tick_s, width_px + 1.0)
        if tick >= ticks - 1:
            at_px = FIRST_PX
        world.data.mocap_pos[0] = (at_px - width_px / 2, 0, 0)

    return capture(
        SCENE,
        ticks * tick_s,
        {
            "sensor": {"width": width_px, "height": HEIGHT_PX},
            "scene": {"tick_us": tick_us},
            "render": {"spp": SPP, "antialiasing": "fixed"},
        },
        act,
    )


def due_s(speed_px_s: float, tick_us: int, width_px: int) -> F64:
    """When each column's events are due, (width, EVENTS), s; a move shows a tick later."""
    n = np.arange(1, EVENTS + 1)
    share = np.expm1(n * THETA) / (BRIGHT / DIM - 1.0)
    passed_px = np.arange(width_px)[:, np.newaxis] + share - FIRST_PX
    due: F64 = passed_px / speed_px_s + tick_us * 1e-6
    return due


def worst_share(seen: Capture, speed_px_s: float, tick_us: int, width_px: int) -> float:
    """How late or early the worst event is, as a share of the bound; inf where a count is wrong.

    The bound is one tick, in which light is linear, plus the time that the edge needs to move from
    one sample to the next.
    """
    back_us = int(seen.report.ticks - 1) * tick_us
    on = seen.within(0, back_us)
    on = on[np.lexsort((on["t"], on["y"], on["x"]))]
    off = seen.within(back_us, back_us + tick_us)
    pixels = width_px * HEIGHT_PX
    if len(on) != pixels * EVENTS or not on["p"].all():
        return math.inf
    if len(off) != pixels * EVENTS or off["p"].any():
        return math.inf
    t_s = on["t"].reshape(width_px, HEIGHT_PX, EVENTS) * 1e-6
    late_s = np.abs(t_s - due_s(speed_px_s, tick_us, width_px)[:, np.newaxis])
    # and a stamp is a whole microsecond
    most_s = tick_us * 1e-6 + 1.0 / SPP / speed_px_s + 1e-6
    return float(late_s.max() / most_s)


def is_explained(seen: Capture) -> bool:
    """Whether the events of every pixel add up to no change: the end is as the begin was."""
    light = np.full((HEIGHT_PX, int(seen.world.cameras[0].info.width)), DIM)
    return residual_thresholds(seen.events, light, light) < 1e-6
