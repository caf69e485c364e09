"""Worlds without a body, with ten thousand, and with a million triangles."""

from __future__ import annotations

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F32, F64, I32
from evs.msgs import EvsError
from evs.tools.stress.capture import capture, differing
from evs.tools.stress.grid_target import capture_scene
from evs.tools.stress.stress_case import Measurement, StressCase

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
    whole = seen.report.ticks == ticks and bool(seen.world.cameras[0].luminance.any())
    return Measurement(len(seen.events) + (not named), 0, "events", (refusal,), whole)


def _crowd(side: int, together: bool) -> str:
    """A square of balls on one slide joint, or on one each; their masses and places are dyadic."""
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
    return f"""<mujoco><option timestep=".001" gravity="0 0 0"/><worldbody>
{EYE.format(1.25 * side)}{inside}</worldbody></mujoco>"""


def _many_bodies(short: bool) -> Measurement:
    side, ticks = (30, 10) if short else (100, 50)

    def roll(tick: int, world: World) -> None:
        if tick == 0:
            # a metre a tick of 1 ms would be 1000: a 64th of one
            world.data.qvel[:] = 15.625

    sensor = {"width": 64, "height": 48}
    seen, one = (
        capture(_crowd(side, together), ticks / 1e3, {"sensor": sensor}, roll)
        for together in (False, True)
    )
    bodies = seen.world.model.nbody - 1
    messages = (*seen.warnings, f"{bodies:,} bodies, events {seen.report.events:,}")
    right = bodies == side * side and one.world.model.nbody == 2 and len(seen.events) > 1000
    return Measurement(differing(seen, one), 0, "events", messages, right)


def _cube(n: int, half: float) -> tuple[F32, I32]:
    """A cube of 12 n^2 triangles, six grids: vertices (nv, 3), faces (nf, 3)."""
    u, v = (
        part.ravel() for part in np.meshgrid(*[np.linspace(-half, half, n + 1)] * 2, indexing="ij")
    )
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (
        part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    grid = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices: list[F64] = []
    faces: list[I32] = []
    for axis in range(3):
        for side in (-1, 1):
            points = np.zeros((len(u), 3))
            points[:, axis], points[:, axis - 2], points[:, axis - 1] = side * half, u, v
            faces.append((grid if side > 0 else grid[:, ::-1]) + len(vertices) * len(u))
            vertices.append(points)
    return np.concatenate(vertices).astype("<f4"), np.concatenate(faces).astype("<i4")


def mesh_file(vertices: F32, faces: I32) -> bytes:
    """MuJoCo's binary mesh (.msh): four counts, vertices, faces."""
    counts = np.array([len(vertices), 0, 0, len(faces)], "<i4")
    return counts.tobytes() + vertices.tobytes() + faces.tobytes()


SOLID = """<mujoco><asset>{}</asset><worldbody><camera name="eye" pos="0 0 5" fovy="45"/>
<geom type="box" size="9 9 .1" pos="0 0 -3" rgba=".4 .5 .6 1"/>
<body name="thing" mocap="true" quat=".9 .3 .2 .1"><geom {} rgba=".8 .3 .2 1" contype="0"
 conaffinity="0"/></body></worldbody></mujoco>"""


def _triangles(short: bool) -> Measurement:
    n, ticks = (58, 20) if short else (289, 100)
    vertices, faces = _cube(n, 1.0)

    def move(tick: int, world: World) -> None:
        world.data.mocap_pos[0] = (-0.5 + tick / ticks, 0.0, 0.0)

    asset, files = '<mesh name="cube" file="cube.msh"/>', {"cube.msh": mesh_file(vertices, faces)}
    mesh = capture_scene(SOLID.format(asset, 'type="mesh" mesh="cube"'), ticks, move, files=files)
    box = capture_scene(SOLID.format("", 'type="box" size="1 1 1"'), ticks, move)
    # the same light but where a sample falls on the other side of an edge by rounding
    apart = np.abs(mesh.light - box.light) > 1e-4 * box.light.max()
    share = float(apart.mean())
    messages = (
        *mesh.capture.warnings,
        f"{len(faces):,} triangles, events {mesh.capture.report.events:,}, as a box "
        f"{box.capture.report.events:,}",
    )
    right = mesh.wrong == 0 and mesh.is_explained and box.capture.report.events > 100
    return Measurement(share, 1e-3, "of the pixels", messages, right)


CASES = (
    StressCase(
        "no-bodies",
        "motion",
        "a world of one still geom and no body; a world of nothing",
        "no event in the first; the second is refused in one line that says what to do",
        _no_bodies,
    ),
    StressCase(
        "ten-thousand-bodies",
        "motion",
        "10,000 balls, each on a joint of its own, roll through the picture",
        "the bytes of one body that carries all the balls: places are sums without rounding",
        _many_bodies,
    ),
    StressCase(
        "a-million-triangles",
        "motion",
        "a cube of 1,002,252 triangles moves through the picture",
        "the light of a box but for samples that rounding puts beside an edge, under 1e-3 of the "
        "pixels; the events are those of ln(light), one by one",
        _triangles,
    ),
)
