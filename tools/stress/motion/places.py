"""A camera inside a geom, a body that is elsewhere at once, physics that blows up."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from evs.drivers.files import read
from evs.drivers.run.report import Report
from evs.emulator import World
from evs.msgs import EvsError, join_events
from evs.tools.stress.capture import capture
from evs.tools.stress.grid_target import capture_scene
from evs.tools.stress.stress_case import Measurement, StressCase

ROOM = """<mujoco><asset><texture name="squares" type="2d" builtin="checker" rgb1=".9 .8 .7"
 rgb2=".2 .2 .3" width="64" height="64"/><material name="floor" texture="squares"
 texrepeat="9 9"/></asset><worldbody><camera name="eye" pos="0 0 0" xyaxes="1 0 0 0 0 1"/>
<geom type="plane" size="30 30 1" pos="0 0 -1" material="floor"/>
<geom type="box" size="9 .1 9" pos="0 8 0" rgba=".4 .5 .6 1"/>
<body name="thing" mocap="true"><geom type="{}" size=".5 .5 .5" rgba=".8 .3 .2 1"/></body>
</worldbody></mujoco>"""

SHAPES = ("sphere", "box", "capsule", "cylinder", "ellipsoid")
FAR = (0.0, -1e3, 0.0)
"""behind the camera"""


def _inside(short: bool) -> Measurement:
    ticks, wrong, events, recovered = 40 if short else 200, 0.0, 0, True
    messages: list[str] = []
    for shape in SHAPES[:2] if short else SHAPES:
        # from before the camera through it to behind it, at rest in the end
        y = np.concatenate([np.linspace(4.0, -4.0, ticks), [-4.0] * 3])

        def move(tick: int, world: World, y: np.ndarray = y) -> None:
            world.data.mocap_pos[0] = (0.0, y[min(tick, len(y) - 1)], 0.0)

        def away(_tick: int, world: World) -> None:
            world.data.mocap_pos[0] = FAR

        mjcf = ROOM.format(shape)
        shown = capture_scene(mjcf, len(y), move)
        (empty,) = {light.tobytes() for light in capture_scene(mjcf, 3, away).light}
        # tick k shows y[k - 1]; a capsule is as long again in z alone
        hidden = np.flatnonzero(y < 0.49) + 1
        wrong += shown.wrong + sum(shown.light[tick].tobytes() != empty for tick in hidden)
        recovered = recovered and shown.is_explained and shown.capture.report.clamps == 0
        events += shown.capture.report.events
        messages += shown.capture.warnings
    return Measurement(wrong, 0, "events or ticks", (*messages, f"events {events:,}"), recovered)


def _teleport(short: bool) -> Measurement:
    ticks = 24 if short else 240
    places = {0: (0.0, 3.0, 0.0), 1: (1e3, 3.0, 0.0), 2: (-1.0, 4.0, 0.5), 3: (1e9, -1e9, 1e9)}

    def move(tick: int, world: World) -> None:
        world.data.mocap_pos[0] = places[tick // 2 % 4 if tick < ticks - 4 else 0]

    shown = capture_scene(ROOM.format("box"), ticks, move)
    first, last = shown.light[0], shown.light[-1]
    messages = (*shown.capture.warnings, f"events {shown.capture.report.events:,}")
    moved = (shown.light[4] != first).mean()
    same = np.array_equal(first, last) and shown.is_explained and moved > 0.01
    return Measurement(shown.wrong + shown.capture.report.clamps, 0, "events", messages, bool(same))


CART = """<mujoco><option timestep=".001"/><worldbody>
<camera name="eye" pos="0 -4 1" xyaxes="1 0 0 0 0 1"/><geom type="plane" size="9 9 1"/>
<body name="cart" pos="0 0 1"><joint name="rail" type="slide" axis="1 0 0"/>
<geom type="box" size=".3 .3 .3" rgba=".8 .3 .2 1"/></body></worldbody></mujoco>"""
SPEED_M_S, PUSH_N = 3.0, 1e14


def _explosion(short: bool) -> Measurement:
    good = 10 if short else 100
    reports: list[Report] = []
    worlds: list[World] = []

    def roll(tick: int, world: World) -> None:
        if tick == 0:
            worlds.append(world)
            world.data.qvel[0] = SPEED_M_S

    def blow(tick: int, world: World) -> None:
        roll(tick, world)
        world.data.qfrc_applied[0] = PUSH_N if tick == good else 0.0

    usual, line = capture(CART, good / 1e3, act=roll), ""
    with TemporaryDirectory() as name:
        try:
            capture(CART, 1.0, act=blow, folder=Path(name), on_report=reports.append)
        except EvsError as error:
            line = str(error)
        recorded = read(Path(name) / "run.aedat4")
    wrong = len(np.setxor1d(recorded, usual.events)) + abs(len(recorded) - len(usual.events))
    named = "unstable at t = " in line and "joint 'rail' of body 'cart'" in line
    (report,) = reports
    ended = report.ended.startswith("error at") and line in report.ended and report.ticks == good
    # the same world from its begin again
    world = worlds[-1]
    world.reset()
    world.data.qvel[0] = SPEED_M_S
    again = join_events([world.step()[0].events for _ in range(good)])
    recovered = np.array_equal(again, usual.events) and len(again) > 0
    return Measurement(wrong + (not named) + (not ended), 0, "events", (report.ended,), recovered)


CASES = (
    StressCase(
        "camera-inside",
        "motion",
        "a sphere, a box, a capsule, a cylinder and an ellipsoid go through the camera",
        "a closed shape around the camera is not seen: then the picture is, to the bit, the one "
        "without it; the events are those of ln(light), one by one",
        _inside,
    ),
    StressCase(
        "teleport",
        "motion",
        "a box is 1 km, then 1e9 m away every other tick, and back where it was",
        "the events of ln(light), one by one; back in its place the picture is the first to the "
        "bit and each pixel's events add up to nothing",
        _teleport,
    ),
    StressCase(
        "exploding-physics",
        "motion",
        "a force of 1e14 N on a cart",
        "the run ends with one line that names time, joint and body; the recording has every event "
        "until then; after a reset the world gives the same bytes again",
        _explosion,
    ),
)
