"""Stress cases of meshes: a million triangles, and meshes that no modeller should make."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F32, F64, I32
from evs.emulator.world import MjModel, load_model
from evs.msgs import EvsError
from evs_lab.stress.grid_target import GridCapture, capture_scene
from evs_lab.stress.stress_case import Measurement, StressCase

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], "<f4")
SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
CUBE = np.concatenate([SIDES[:, [0, 1, 2]], SIDES[:, [0, 2, 3]]]).astype("<i4")
MESH = 'type="mesh" mesh="cube"'
THIN_M = 1e-6
"""half the thickness of the box that the sheet is compared to: float32 cannot resolve the sides of
a box thinner than 1e-7 of its distance"""

POINTS = {"plan": {"off": ["outlines"]}}
"""meshes are sampled by points, and so must be the boxes that they are compared to"""

MOST_APART = 1e-3
"""share of the pixels: an eighth of them have an edge in them, and in one of a hundred of these a
sample may be as near to it as float32 rounds"""

NUMBERS = """<mujoco><asset><mesh name="cube" file="cube.msh" inertia="shell"/>
<hfield name="hills" nrow="3" ncol="3" size="1 1 1 1" elevation="0 1 0 1 2 1 0 1 0"/></asset>
<worldbody><camera pos="0 0 9"/><geom type="mesh" mesh="cube"/>
<geom type="hfield" hfield="hills"/></worldbody></mujoco>"""

SOLID = """<mujoco><statistic extent="9"/><asset>{}</asset><worldbody>
<camera name="eye" pos="0 0 5" fovy="45"/>
<geom type="box" size="9 9 .1" pos="0 0 -3" rgba=".4 .5 .6 1"/>
<body name="thing" mocap="true" quat=".9 .3 .2 .1"><geom {} rgba=".8 .3 .2 1" contype="0"
 conaffinity="0"/></body></worldbody></mujoco>"""


def mesh_file(vertices: F32, faces: I32) -> bytes:
    """Content of MuJoCo's binary mesh format (.msh): four counts, vertices, faces."""
    counts = np.array([len(vertices), 0, 0, len(faces)], "<i4")
    return counts.tobytes() + vertices.tobytes() + faces.tobytes()


def _fine_cube(n: int, half: float) -> tuple[F32, I32]:
    """Build a cube of 12 n^2 triangles in six grids.

    Args:
        n: squares along an edge.
        half: half its edge, m.

    Returns:
        Vertices (nv, 3) float32 and faces (nf, 3) int32.
    """
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


def _triangles(short: bool) -> Measurement:
    n, ticks = (58, 20) if short else (289, 100)
    vertices, faces = _fine_cube(n, 1.0)

    def move(tick: int, world: World) -> None:
        world.data.mocap_pos[0] = (-0.5 + tick / ticks, 0.0, 0.0)

    asset, files = '<mesh name="cube" file="cube.msh"/>', {"cube.msh": mesh_file(vertices, faces)}
    mesh = capture_scene(SOLID.format(asset, MESH), ticks, move, POINTS, files)
    box = capture_scene(SOLID.format("", 'type="box" size="1 1 1"'), ticks, move, POINTS)
    # the same light but where a sample falls on the other side of an edge by rounding
    apart = np.abs(mesh.light - box.light) > 1e-4 * box.light.max()
    share = float(apart.mean())
    messages = (
        *mesh.capture.warnings,
        f"{len(faces):,} triangles: {mesh.capture.report.events:,} events, as a box "
        f"{box.capture.report.events:,}",
    )
    right = mesh.wrong == 0 and mesh.is_explained and box.capture.report.events > 100
    return Measurement(share, 1e-3, "of the pixels", messages, right)


def _degraded(name: str, vertices: F32, faces: I32) -> tuple[F32, I32]:
    """The same surface with degenerate triangles, doubled ones, or unused vertices."""
    if name == "zero area":
        # points, and edges there and back
        points = np.repeat(np.arange(8, dtype="<i4")[:, None], 3, 1)
        return vertices, np.concatenate([points, faces, faces[:, [0, 1, 0]], faces[:, [1, 2, 2]]])
    if name == "duplicates":
        # every corner of every triangle is a vertex of its own, and every triangle is there twice
        apart = np.arange(3 * len(faces), dtype="<i4").reshape(-1, 3)
        return vertices[faces.ravel()], np.concatenate([apart, apart])
    # vertices that no triangle uses, a long way off
    return np.concatenate([vertices, vertices * np.float32(1e6)]), faces


def _move(tick: int, world: World) -> None:
    world.data.mocap_pos[0] = (0.02 * tick, 0.0, 0.0)


def _apart(one: GridCapture, other: GridCapture) -> float:
    """Share of the pixels whose light differs; inf where the events are not those of ln(light).

    MuJoCo puts a mesh into the frame of its inertia, in float32, so samples at an edge may change.
    """
    wrong = one.wrong + other.wrong + one.capture.report.clamps
    apart = np.abs(one.light - other.light) > 1e-4 * other.light.max()
    return float(apart.mean()) if wrong == 0 else math.inf


def _degenerate(short: bool) -> Measurement:
    ticks, worst = 10 if short else 60, 0.0
    messages: list[str] = []
    mjcf = SOLID.format('<mesh name="cube" file="cube.msh" inertia="shell"/>', MESH)
    usual = capture_scene(mjcf, ticks, _move, files={"cube.msh": mesh_file(CORNERS, CUBE)})
    recovered = usual.is_explained
    for name in ("zero area", "duplicates", "unused vertices"):
        bad = {"cube.msh": mesh_file(*_degraded(name, CORNERS, CUBE))}
        shown = capture_scene(mjcf, ticks, _move, files=bad)
        worst, recovered = max(worst, _apart(shown, usual)), recovered and shown.is_explained
        messages += [f"{name}: {shown.capture.report.events:,} events", *shown.capture.warnings]
    messages.append(f"intact: {usual.capture.report.events:,} events")
    return Measurement(worst, MOST_APART, "of the pixels", tuple(messages), recovered)


def _sheet(short: bool) -> Measurement:
    ticks = 10 if short else 60
    # no turn: a box's sides would be seen, a sheet has none
    scene = SOLID.replace('quat=".9 .3 .2 .1"', "").replace(".4 .5 .6 1", ".05 .05 .05 1")
    front = (CORNERS[[1, 5, 7, 3]] * (1, 1, 0)).astype("<f4")
    files = {"cube.msh": mesh_file(front, np.array([[0, 1, 2], [0, 2, 3]], "<i4"))}
    asset = '<mesh name="cube" file="cube.msh" inertia="shell"/>'
    thin = scene.format("", f'type="box" size="1 1 {THIN_M}"')
    sheet = capture_scene(scene.format(asset, MESH), ticks, _move, POINTS, files)
    box = capture_scene(thin, ticks, _move, POINTS)
    right = sheet.is_explained and box.is_explained and box.capture.report.events > 50
    messages = (*sheet.capture.warnings, f"{sheet.capture.report.events:,} events")
    return Measurement(_apart(sheet, box), MOST_APART, "of the pixels", messages, right)


def _no_numbers(short: bool) -> Measurement:
    """Count the meshes and height fields with NaN and infinite numbers that are accepted."""
    missed, messages = 0, []
    for number in ("nan",) if short else ("nan", "inf", "-inf"):
        for what, corrupt in CORRUPTIONS.items():
            model = _model()
            corrupt(model, float(number))
            try:
                World(model)
                missed += 1
            except EvsError as refusal:
                messages.append(str(refusal))
                missed += messages[-1] != (
                    f"{what} has 1 value that is not finite; use finite numbers"
                )
    world = World(_model())
    world.add_camera(sensor="ideal")
    return Measurement(missed, 0, "meshes accepted", tuple(messages), len(world.step()) == 1)


def _model() -> MjModel:
    """A valid mesh and a valid height field."""
    with TemporaryDirectory() as name:
        (Path(name) / "cube.msh").write_bytes(mesh_file(CORNERS, CUBE))
        scene = Path(name) / "scene.xml"
        scene.write_text(NUMBERS, encoding="utf-8")
        return load_model(scene)


def _corrupt_mesh(model: MjModel, number: float) -> None:
    model.mesh_vert[3, 1] = number


def _corrupt_field(model: MjModel, number: float) -> None:
    model.hfield_data[2] = number


CORRUPTIONS: dict[str, Callable[[MjModel, float], None]] = {
    "mesh 'cube'": _corrupt_mesh,
    "height field 'hills'": _corrupt_field,
}
"""what is made invalid, as an error names it -> how"""

CASES = (
    StressCase(
        "a-million-triangles",
        "motion",
        "a cube with 1,002,252 triangles moves through the picture",
        "the light of a box, except for samples that rounding moves across an edge (in fewer than "
        "1e-3 of the pixels); the events match ln(light) one by one",
        _triangles,
    ),
    StressCase(
        "degenerate-meshes",
        "motion",
        "a cube with extra triangles that are points or lines; with every triangle duplicated and "
        "no vertices shared within a copy; with distant, unused vertices",
        "the light of the cube, except for samples that rounding moves across an edge (in fewer "
        "than 1e-3 of the pixels); the events match ln(light) one by one",
        _degenerate,
    ),
    StressCase(
        "flat-mesh",
        "motion",
        "a mesh without thickness at a distance of 5 m, compared with a box 2 um thick",
        "the same light, except for samples that rounding moves across an edge (in fewer than 1e-3 "
        "of the pixels); the events match ln(light) one by one",
        _sheet,
    ),
    StressCase(
        "meshes-of-no-numbers",
        "motion",
        "a mesh with NaN or infinite vertices, and a height field with NaN or infinite heights",
        "each is rejected with a one-line message that names it",
        _no_numbers,
    ),
)
