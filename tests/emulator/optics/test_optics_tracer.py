"""Lenses in the tracer: things appear where OpenCV projects them, and the bytes stay the same."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.optics import project
from evs.emulator.render import make_renderer
from evs.msgs import EvsError
from reference.instants import Film

WIDTH, HEIGHT = 173, 131  # no multiple of a packet
PLUMB_BOB = CameraConfig(
    focal_px=(146.0, 144.0),
    principal_px=(88.3, 63.9),
    distortion_model="plumb_bob",
    distortion=(-0.31, 0.12, 0.0011, -0.0007, -0.02),
)
RATIONAL = replace(
    PLUMB_BOB,
    focal_px=(86.0, 85.0),
    distortion_model="rational_polynomial",
    distortion=(0.61, 0.11, 0.0003, -0.0002, 0.008, 0.98, 0.29, 0.03),
)
FISHEYE = replace(
    PLUMB_BOB,
    focal_px=(74.0, 75.0),
    distortion_model="equidistant",
    distortion=(0.02, -0.006, 0.003, -0.0009),
)
# 230 degrees across the height: the image circle ends inside the width
BEHIND = replace(FISHEYE, focal_px=(24.0, 24.0), distortion=(0.0, 0.0, 0.0, 0.0))
VIEWS = {"plumb_bob": PLUMB_BOB, "rational": RATIONAL, "fisheye": FISHEYE, "behind": BEHIND}
VIEW = pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)


def film_of(bodies: str, view: CameraConfig, sky: bool = True) -> Film:
    """Make a film of a free camera in the origin of a world, looking along x, z up."""
    xml = f"""
        <mujoco><option timestep=".001"/>
          <visual><headlight ambient=".1 .1 .1" diffuse=".4 .4 .4"/></visual>
          <asset>
            <texture name="sky" type="{"skybox" if sky else "cube"}" builtin="gradient"
              rgb1=".3 .5 .7" rgb2=".1 0 0" width="32" height="192"/>
            <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .6"
              width="64" height="64"/>
            <material name="glow" emission="1" specular="0" rgba="1 1 1 1"/>
            <material name="floor" texture="tiles" texrepeat="1 1" texuniform="true"
              reflectance=".3"/>
          </asset>
          <worldbody><body name="eye" pos="0 0 0"/>{bodies}</worldbody>
        </mujoco>"""
    mounted = replace(view, body="eye", xyaxes=(0.0, -1.0, 0.0, 0.0, 0.0, 1.0))
    return Film(xml, (WIDTH, HEIGHT), mounted)


def in_camera(points: np.ndarray) -> np.ndarray:
    """Points (n, 3) of the world in the frame of the film's camera: x right, y up, -z ahead."""
    return np.stack([-points[:, 1], points[:, 2], -points[:, 0]], 1)


def opencv(camera, points: np.ndarray) -> np.ndarray:
    """(n, 2) px of points (n, 3) in the camera's frame, before the camera."""
    seen = np.ascontiguousarray((points * [1, -1, -1])[:, np.newaxis])
    matrix = np.array([[camera.fx, 0, camera.cx - 0.5], [0, camera.fy, camera.cy - 0.5], [0, 0, 1]])
    fisheye = camera.distortion_model == "equidistant"
    call = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    return call(seen, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion))[0][:, 0] + 0.5


def field(count: int, seed: int) -> str:
    """Spheres in all directions, 1 ... 6 m away."""
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(count, 3))
    d *= rng.uniform(1.0, 6.0, (count, 1)) / np.linalg.norm(d, axis=1, keepdims=True)
    sizes = rng.uniform(0.02, 0.25, count)
    colours = rng.uniform(0.2, 1.0, (count, 3))
    return "".join(
        f'<geom type="sphere" pos="{x} {y} {z}" size="{s}" rgba="{r} {g} {b} 1"/>'
        for (x, y, z), s, (r, g, b) in zip(d, sizes, colours, strict=True)
    )


ROOM = """
    <light type="directional" dir=".3 .2 -1" diffuse=".5 .5 .5"/>
    <light type="point" pos="0 0 2" diffuse=".3 .3 .3"/>
    <geom type="plane" size="0 0 .1" pos="0 0 -1" material="floor"/>
"""


@pytest.mark.parametrize("name", ["plumb_bob", "rational", "fisheye"])
def test_small_spheres_appear_where_opencv_projects_them(name: str) -> None:
    # one radian is some 100 px: these are 3 to 5 px wide
    away = 10.0
    slopes = np.array([[-0.45, 0.3], [0.0, 0.0], [0.42, 0.33], [0.5, -0.31], [-0.2, -0.35]])
    points = np.column_stack([np.ones(5), slopes])
    points *= away / np.linalg.norm(points, axis=1, keepdims=True)
    text = "".join(
        f'<geom type="sphere" pos="{x} {y} {z}" size=".2" material="glow"/>' for x, y, z in points
    )
    film = film_of(text, VIEWS[name], sky=False)
    (frame,) = film.snapshots()
    renderer = film.renderer(spp=64, headlight="off")
    light = renderer.render(frame, frame.cameras[0]).astype(np.float64)
    where = opencv(film.camera, in_camera(points))
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    seen = 0
    for u, v in where:
        near = np.hypot(x - u, y - v) < 8
        if not (8 < u < WIDTH - 8 and 8 < v < HEIGHT - 8):
            continue
        weight = np.where(near, light, 0.0)
        assert weight.sum() > 3
        found = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
        assert np.hypot(*(found - (u, v))) < 0.05
        seen += 1
    assert seen >= 4


@pytest.mark.parametrize("name", ["plumb_bob", "rational", "fisheye"])
def test_the_point_in_a_pixels_centre_is_projected_to_it(name: str) -> None:
    film = film_of('<geom type="box" size="3 2 1.5" pos="4 0 0"/>', VIEWS[name])
    (frame,) = film.snapshots()
    truth = film.renderer(spp=2).ground_truth(frame, frame.cameras[0])
    seen = truth.geom_id >= 0
    assert seen.mean() > 0.02
    image = opencv(film.camera, in_camera(truth.position[seen].astype(np.float64)))
    rows, columns = np.nonzero(seen)
    # 0.01: half the resolution of lens.py's figure; float32 positions are good to 1e-4 px
    np.testing.assert_allclose(image, np.stack([columns, rows], 1) + 0.5, atol=0.01)


def test_a_fisheye_sees_what_is_behind_it() -> None:
    # 100 degrees off the axis, to the left and above
    angle = np.radians(100)
    directions = np.array([[np.cos(angle), np.sin(angle), 0], [np.cos(angle), 0, np.sin(angle)]])
    text = "".join(
        f'<geom type="sphere" pos="{x} {y} {z}" size=".6" material="glow"/>'
        for x, y, z in 5 * directions
    )
    film = film_of(text, BEHIND)
    (frame,) = film.snapshots()
    geom, distance = film.renderer(spp=2).hits(frame, frame.cameras[0])
    camera = film.camera
    left = (camera.cx - 24 * angle, camera.cy)
    above = (camera.cx, camera.cy - 24 * angle)
    for index, (x, y) in enumerate((left, above)):
        assert geom[int(y), int(x)] == index
        assert distance[int(y), int(x)] == pytest.approx(4.4, abs=0.02)


def test_outside_the_image_circle_it_is_dark_and_nothing_is_hit() -> None:
    film = film_of(ROOM, BEHIND)
    before, now = film.snapshots(2)
    renderer = film.renderer(spp=2)
    light = renderer.render(now, now.cameras[0])
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    camera = film.camera
    r = np.hypot((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy)
    outside = r > np.pi
    assert 0.05 < outside.mean() < 0.5
    assert (light[outside] == 0).all()
    assert (light[r < np.pi - 0.1] > 0).all()
    truth = renderer.ground_truth(now, now.cameras[0], (before, before.cameras[0]))
    assert (truth.geom_id[outside] == -1).all()
    assert np.isinf(truth.depth[outside]).all()
    assert np.isnan(truth.flow[outside]).all()
    assert np.isnan(truth.position[outside]).all()
    geom, distance = renderer.hits(now, now.cameras[0])
    assert (geom[outside] == -1).all()
    assert (distance[outside] == 0).all()


@pytest.mark.parametrize(
    "antialiasing", ["fixed", pytest.param("adaptive", marks=pytest.mark.slow)]
)
@VIEW
def test_no_packet_misses_what_its_rays_hit(view: CameraConfig, antialiasing: str) -> None:
    # a frame asks each packet's hull which geoms it can touch; single pixels ask their own rays
    for seed in range(3):
        film = film_of(ROOM + field(150, seed), replace(view, vignetting_polynomial=(-0.3,)))
        (frame,) = film.snapshots()
        renderer = film.renderer(spp=4, antialiasing=antialiasing)
        light = renderer.render(frame, frame.cameras[0])
        every = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
        # in another order, so that pixels far apart share a packet
        np.random.default_rng(seed).shuffle(every)
        alone = renderer.trace(frame, frame.cameras[0], every)
        np.testing.assert_array_equal(light[every[:, 1], every[:, 0]], alone)


@VIEW
def test_threads_and_instruction_sets_give_the_same_bytes(view: CameraConfig) -> None:
    film = film_of(ROOM + field(40, 5), replace(view, vignetting="cos4"))
    (frame,) = film.snapshots()
    found = {
        film.renderer(threads, spp=2, isa=isa).render(frame, frame.cameras[0]).tobytes()
        for isa in _core.isa_available()
        for threads in (1, 3)
    }
    assert len(found) == 1


@VIEW
def test_incremental_equals_full_tracing(view: CameraConfig) -> None:
    falling = """<body pos="1.5 .2 .8"><freejoint/>
        <geom type="capsule" size=".1 .3" euler="30 40 0"/><geom type="box" size=".1 .2 .1"/></body>
      <body pos="-1.5 .2 .9"><freejoint/><geom type="sphere" size=".2"/></body>"""
    film = film_of(ROOM + field(10, 3) + falling, view)
    kept, full = film.renderer(spp=2), film.renderer(spp=2, incremental=False)
    fractions = []
    for frame in film.snapshots(120):
        a, b = (r.render(frame, frame.cameras[0]) for r in (kept, full))
        np.testing.assert_array_equal(a, b)
        fractions.append(kept.traced_fraction)
    assert fractions[0] == 1
    assert 0 < np.mean(fractions[1:]) < 0.8


def test_no_distortion_and_all_zero_distortion_give_the_same_bytes() -> None:
    plain = replace(PLUMB_BOB, distortion_model="none", distortion=())
    frames = []
    for view in (plain, replace(PLUMB_BOB, distortion=(0.0,) * 5)):
        film = film_of(ROOM + field(20, 1), view)
        (frame,) = film.snapshots()
        frames.append(film.renderer(spp=2).render(frame, frame.cameras[0]).tobytes())
    assert frames[0] == frames[1]


def test_a_lens_that_bends_next_to_nothing_shows_the_pinholes_picture() -> None:
    plain = replace(PLUMB_BOB, distortion_model="none", distortion=())
    hits = []
    for view in (plain, replace(PLUMB_BOB, distortion=(1e-9, 0.0, 0.0, 0.0, 0.0))):
        film = film_of(ROOM + field(20, 1), view)
        (frame,) = film.snapshots()
        hits.append(film.renderer(spp=2).hits(frame, frame.cameras[0]))
    same = hits[0][0] == hits[1][0]
    assert same.mean() > 0.9995  # a silhouette may run through a pixel's centre
    np.testing.assert_allclose(hits[0][1][same], hits[1][1][same], rtol=1e-3)


def test_the_flow_is_that_of_the_distorted_image() -> None:
    film = film_of(
        '<body pos="3 0 0"><freejoint/><geom type="box" size=".5 3 2"/></body>', RATIONAL
    )
    film.data.qpos[1:3] = (0.004, -0.006)
    before, now = film.shot, film.taker.snapshot(film.data, 1000)
    truth = film.renderer(spp=2).ground_truth(now, now.cameras[0], (before, before.cameras[0]))
    seen = truth.geom_id >= 0
    assert seen.mean() > 0.3
    points = truth.position[seen].astype(np.float64)
    camera = film.camera
    here, there = (opencv(camera, in_camera(points - step)) for step in (0, [0, 0.004, -0.006]))
    np.testing.assert_allclose(truth.flow[seen], (here - there) / 1e-3, rtol=1e-3, atol=0.1)
    np.testing.assert_allclose(project(camera, in_camera(points)), here, atol=1e-9)


def test_raster_refuses_a_lens() -> None:
    film = film_of(ROOM, PLUMB_BOB)
    with pytest.raises(EvsError, match="no lens distortion"):
        make_renderer(film.scene, film.camera, RenderConfig(renderer="raster"), 1)
