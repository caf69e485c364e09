"""Worlds of a micrometre and of a thousand kilometres: the same picture, the same events."""

from __future__ import annotations

import math

import numpy as np

from evs.emulator import World
from evs.tools.stress.closed_form import event_counts
from evs.tools.stress.grid_target import GridCapture, capture_scene
from evs.tools.stress.motion.many import mesh_file
from evs.tools.stress.motion.meshes import CORNERS, CUBE
from evs.tools.stress.stress_case import Measurement, StressCase

SIDE_PX = 48
MOST = 1e-3
"""share of pixels and of events: lengths are float32, right to 1e-7 of a picture of 1e2 px, whose
edges cross it some ten times"""


def _world(scale: float) -> str:
    """Every length times `scale`; lights without a distance, so that none of them fades."""

    def m(*lengths: float) -> str:
        return " ".join(repr(length * scale) for length in lengths)

    return f"""<mujoco><asset><mesh name="cube" file="cube.msh" inertia="shell"
 scale="{m(0.4, 0.4, 0.4)}"/></asset><worldbody>
<camera name="eye" pos="{m(0, -4, 2)}" xyaxes="1 0 0 0 .45 .9" fovy="45"/>
<light directional="true" dir=".3 .4 -1" diffuse=".6 .6 .6"/>
<geom type="box" size="{m(5, 5, 0.1)}" pos="{m(0, 0, -0.1)}" rgba=".5 .6 .7 1"/>
<geom type="sphere" size="{m(0.5)}" pos="{m(-0.9, 0, 0.5)}" rgba=".9 .8 .3 1"/>
<geom type="cylinder" size="{m(0.3, 0.5)}" pos="{m(1.1, 0.6, 0.5)}" rgba=".3 .8 .4 1"/>
<body name="ball" mocap="true"><geom type="ellipsoid" size="{m(0.3, 0.2, 0.4)}"
 rgba=".8 .2 .2 1" contype="0" conaffinity="0"/></body>
<body name="box" mocap="true"><geom type="mesh" mesh="cube" rgba=".2 .3 .8 1" contype="0"
 conaffinity="0"/></body></worldbody></mujoco>"""


def _seen(scale: float, ticks: int) -> GridCapture:
    def move(tick: int, world: World) -> None:
        along = tick / ticks
        world.data.mocap_pos[0] = np.array([-2 + 4 * along, -1.0, 0.5]) * scale
        world.data.mocap_pos[1] = np.array([0.3, 1.5 - along, 0.4 + 0.8 * along]) * scale
        turn = math.pi * along / 2
        world.data.mocap_quat[1] = (math.cos(turn), 0.3 * math.sin(turn), 0, math.sin(turn))

    files = {"cube.msh": mesh_file(CORNERS, CUBE)}
    sensor = {"width": SIDE_PX, "height": SIDE_PX}
    return capture_scene(_world(scale), ticks, move, sensor, files)


def _scales(short: bool) -> Measurement:
    ticks, worst = 15 if short else 150, 0.0
    usual = _seen(1.0, ticks)
    counted = event_counts(usual.capture.events, ticks, 1000, (SIDE_PX, SIDE_PX))
    messages, recovered = [f"1 m: events {usual.capture.report.events:,}"], usual.is_explained
    for scale in (1e-6, 1e6) if short else (1e-6, 1e-3, 1e3, 1e6):
        shown = _seen(scale, ticks)
        apart = np.abs(shown.light - usual.light) > 1e-3 * usual.light.max()
        counts = event_counts(shown.capture.events, ticks, 1000, (SIDE_PX, SIDE_PX))
        other = float(np.abs(counts - counted).sum() / counted.sum())
        worst = max(worst, float(apart.mean()), other)
        recovered = recovered and shown.is_explained and shown.wrong == usual.wrong == 0
        messages += [
            f"{scale:g} m: events {shown.capture.report.events:,}",
            *shown.capture.warnings,
        ]
    return Measurement(worst, MOST, "of pixels, events", tuple(messages), recovered)


CASES = (
    StressCase(
        "world-scales",
        "motion",
        "the same scene at 1e-6, 1e-3, 1e3 and 1e6 times its size",
        "the same light but where a sample is as near to an edge, and the same events in the same "
        "ticks but where a crossing is as near to a tick's end, as float32 rounds: under 1e-3",
        _scales,
    ),
)
