"""Stress cases of motion: speeds, places, broken physics, many bodies, scales of the world."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from evs.drivers.files import read
from evs.drivers.run.report import Report
from evs.emulator import World
from evs.msgs import EvsError, join_events
from evs_lab.stress import meshes
from evs_lab.stress.capture import capture, differing
from evs_lab.stress.closed_form import event_counts
from evs_lab.stress.grid_target import HEIGHT_PX, GridCapture, capture_scene
from evs_lab.stress.meshes import CORNERS, CUBE, mesh_file
from evs_lab.stress.moving_edge import EVENTS, capture_edge, is_explained, worst_share
from evs_lab.stress.stress_case import Measurement, StressCase

SPEEDS = (
    (1e-6, 250_000_000, 1),
    (1e-3, 10_000_000, 4),
    (1.0, 10_000, 4),
    (1e3, 10, 4),
    (1e3, 1000, 32),
    (1e6, 10, 32),
    (1e6, 1000, 32),
)
"""px/s, ticks of so many us, width of the picture: a pixel at 1e-6 px/s takes 11.6 days"""


def _speeds(short: bool) -> Measurement:
    worst, recovered, messages = 0.0, True, []
    for speed_px_s, tick_us, width_px in SPEEDS[2:] if short else SPEEDS:
        seen = capture_edge(speed_px_s, tick_us, width_px)
        share = worst_share(seen, speed_px_s, tick_us, width_px)
        worst, recovered = max(worst, share), recovered and is_explained(seen)
        rate = EVENTS * HEIGHT_PX * speed_px_s
        messages.append(
            f"{speed_px_s:g} px/s in ticks of {tick_us} us: {rate:g} events/s, {share:.2f} of the "
            "bound"
        )
        messages += seen.warnings
    return Measurement(worst, 1.0, "of the bound", tuple(messages), recovered)


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

FIXED = {"render": {"antialiasing": "fixed"}}
"""the light of a pixel that is refined for a while comes back but for the last bit"""


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
        shown = capture_scene(mjcf, len(y), move, FIXED)
        (empty,) = {light.tobytes() for light in capture_scene(mjcf, 3, away, FIXED).light}
        # tick k shows y[k - 1]; a capsule is as long again in z alone
        hidden = np.flatnonzero(y < 0.49) + 1
        wrong += shown.wrong + sum(shown.light[tick].tobytes() != empty for tick in hidden)
        recovered = recovered and shown.is_explained and shown.capture.report.clamps == 0
        events += shown.capture.report.events
        messages += shown.capture.warnings
    return Measurement(
        wrong, 0, "wrong events or ticks", (*messages, f"{events:,} events"), recovered
    )


def _teleport(short: bool) -> Measurement:
    ticks = 24 if short else 240
    places = {0: (0.0, 3.0, 0.0), 1: (1e3, 3.0, 0.0), 2: (-1.0, 4.0, 0.5), 3: (1e9, -1e9, 1e9)}

    def move(tick: int, world: World) -> None:
        world.data.mocap_pos[0] = places[tick // 2 % 4 if tick < ticks - 4 else 0]

    shown = capture_scene(ROOM.format("box"), ticks, move)
    first, last = shown.light[0], shown.light[-1]
    messages = (*shown.capture.warnings, f"{shown.capture.report.events:,} events")
    moved = (shown.light[4] != first).mean()
    same = np.array_equal(first, last) and shown.is_explained and moved > 0.01
    return Measurement(
        shown.wrong + shown.capture.report.clamps, 0, "wrong events", messages, bool(same)
    )


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
    return Measurement(
        wrong + (not named) + (not ended), 0, "wrong events", (report.ended,), recovered
    )


EYE = '<camera name="eye" pos="0 0 {}" fovy="45"/>'


def _no_bodies(short: bool) -> Measurement:
    ticks = 10 if short else 100
    still = f'<mujoco><worldbody>{EYE.format(5)}<geom size="1" type="sphere"/></worldbody></mujoco>'
    seen = capture(still, ticks / 1e3)
    refusal = ""
    try:
        capture(f"<mujoco><worldbody>{EYE.format(5)}</worldbody></mujoco>", ticks / 1e3)
    except EvsError as error:
        refusal = str(error)
    named = "nothing to see" in refusal and "give the scene some geometry" in refusal
    complete = seen.report.ticks == ticks and bool(seen.world.cameras[0].luminance.any())
    return Measurement(len(seen.events) + (not named), 0, "wrong events", (refusal,), complete)


def _crowd(side: int, together: bool) -> str:
    """A square of balls on one slide joint, or on one each; masses and positions are dyadic."""
    slide = '<joint type="slide" axis="1 0 0"/>'
    ball = '<geom size=".375" mass="1" contype="0" conaffinity="0" rgba="{} .5 .5 1" {}/>'
    balls = []
    for k in range(side * side):
        where = f'pos="{k % side - side / 2} {k // side - side / 2} 0"'
        red = (k * 7 % 10 + 1) / 10
        balls.append(
            ball.format(red, where) if together
            else f"<body {where}>{slide}{ball.format(red, '')}</body>"
        )  # fmt: skip
    inside = f"<body>{slide}{''.join(balls)}</body>" if together else "".join(balls)
    return f"""<mujoco><option timestep=".001" gravity="0 0 0" solver="CG"/><worldbody>
{EYE.format(1.25 * side)}{inside}</worldbody></mujoco>"""


def _many_bodies(short: bool) -> Measurement:
    side, ticks = (30, 10) if short else (100, 50)

    def roll(tick: int, world: World) -> None:
        if tick == 0:
            # 1/64 m a tick of 1 ms
            world.data.qvel[:] = 15.625

    sensor = {"width": 64, "height": 48}
    seen, one = (
        capture(_crowd(side, together), ticks / 1e3, {"sensor": sensor}, roll)
        for together in (False, True)
    )
    bodies = seen.world.model.nbody - 1
    messages = (*seen.warnings, f"{bodies:,} bodies: {seen.report.events:,} events")
    right = bodies == side * side and one.world.model.nbody == 2 and len(seen.events) > 1000
    return Measurement(differing(seen, one), 0, "wrong events", messages, right)


SIDE_PX = 48
MOST_APART = 1e-3
"""share of pixels and of events: lengths are float32, right to 1e-7 of a picture of 1e2 px, whose
edges cross it some ten times"""


def _scaled_world(scale: float) -> str:
    """The scene with every length times `scale`; its light is directional, so none fades."""

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


def _capture_scaled(scale: float, ticks: int) -> GridCapture:
    def move(tick: int, world: World) -> None:
        along = tick / ticks
        world.data.mocap_pos[0] = np.array([-2 + 4 * along, -1.0, 0.5]) * scale
        world.data.mocap_pos[1] = np.array([0.3, 1.5 - along, 0.4 + 0.8 * along]) * scale
        turn = math.pi * along / 2
        world.data.mocap_quat[1] = (math.cos(turn), 0.3 * math.sin(turn), 0, math.sin(turn))

    files = {"cube.msh": mesh_file(CORNERS, CUBE)}
    tables = {"sensor": {"width": SIDE_PX, "height": SIDE_PX}}
    return capture_scene(_scaled_world(scale), ticks, move, tables, files)


def _scales(short: bool) -> Measurement:
    ticks, worst = 15 if short else 150, 0.0
    usual = _capture_scaled(1.0, ticks)
    counted = event_counts(usual.capture.events, ticks, 1000, (SIDE_PX, SIDE_PX))
    messages, recovered = [f"1 m: {usual.capture.report.events:,} events"], usual.is_explained
    for scale in (1e-6, 1e6) if short else (1e-6, 1e-3, 1e3, 1e6):
        shown = _capture_scaled(scale, ticks)
        apart = np.abs(shown.light - usual.light) > 1e-3 * usual.light.max()
        counts = event_counts(shown.capture.events, ticks, 1000, (SIDE_PX, SIDE_PX))
        other = float(np.abs(counts - counted).sum() / counted.sum())
        worst = max(worst, float(apart.mean()), other)
        recovered = recovered and shown.is_explained and shown.wrong == usual.wrong == 0
        messages += [
            f"{scale:g} m: {shown.capture.report.events:,} events",
            *shown.capture.warnings,
        ]
    return Measurement(worst, MOST_APART, "of the pixels or events", tuple(messages), recovered)


CASES = (
    StressCase(
        "speeds",
        "motion",
        "an edge that moves at 1e-6, 1e-3, 1, 1e3 and 1e6 px/s, in ticks of 10 us ... 250 s",
        "floor(ln(bright / dim) / threshold) = 8 events per pixel, each at its closed-form time to "
        "within a tick plus the time in which the edge moves 1/64 of a pixel",
        _speeds,
    ),
    StressCase(
        "camera-inside",
        "motion",
        "a sphere, a box, a capsule, a cylinder and an ellipsoid pass through the camera",
        "a closed shape around the camera is invisible: while it is there, the picture is "
        "bit-identical to the one without it; the events match ln(light) one by one",
        _inside,
    ),
    StressCase(
        "teleport",
        "motion",
        "every other tick, a box jumps 1 km or 1e9 m away, or back in front of the camera",
        "the events match ln(light) one by one; once the box is back in its first place, the "
        "picture is bit-identical to the first and each pixel's events add up to zero",
        _teleport,
    ),
    StressCase(
        "exploding-physics",
        "motion",
        "a force of 1e14 N on a cart",
        "the run ends with one line that names the time, the joint and the body; the recording has "
        "every event up to that time; after a reset, the world gives the same bytes again",
        _explosion,
    ),
    StressCase(
        "no-bodies",
        "motion",
        "a world with one static geom and no bodies; an empty world",
        "no events in the first; the second is rejected with a one-line message that states what "
        "to do",
        _no_bodies,
    ),
    StressCase(
        "ten-thousand-bodies",
        "motion",
        "10,000 balls, each on its own joint, roll through the picture",
        "the same bytes as with one body that carries all the balls, because positions are sums "
        "without rounding",
        _many_bodies,
    ),
    *meshes.CASES,
    StressCase(
        "world-scales",
        "motion",
        "the same scene at 1e-6, 1e-3, 1e3 and 1e6 times its size",
        "the same light, and the same events in the same ticks, except where float32 rounding "
        "moves a sample across an edge or a threshold crossing across the end of a tick (in fewer "
        "than 1e-3 of the pixels and of the events)",
        _scales,
    ),
)
