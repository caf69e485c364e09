"""Scenes that nobody sane builds, and some that somebody will: no pinhole, no NaN, no crash."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import (
    CameraModel,
    CameraPose,
    Light,
    LightKind,
    Mesh,
    SceneModel,
    SceneSnapshot,
    Shape,
    Surface,
    Texture,
    TextureKind,
)
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer
from reference.scenes import camera_of, scene_of, shot_of

pytestmark = pytest.mark.extremes

EYE = np.eye(3).reshape(9)
MIRROR, GLOW = Surface((0, 0, 0, 1), specular=0, reflectance=1.0), Surface((1, 1, 1, 1), emission=1)


def looking_down(height: float, x: float = 0.0, y: float = 0.0) -> CameraPose:
    return CameraPose(np.array([x, y, height]), EYE.copy())


def everywhere(
    scene: SceneModel, camera: CameraModel, shots: list[SceneSnapshot], poses: list[CameraPose]
) -> list[np.ndarray]:
    """The light of every shot; the same on every instruction set, kept or anew, and finite."""
    config = RenderConfig(spp=1)
    full = NativeRenderer(scene, camera, replace(config, incremental=False), 1)
    others = [NativeRenderer(scene, camera, replace(config, isa=isa), 2)
              for isa in _core.isa_available()]  # fmt: skip
    seen = []
    for shot, pose in zip(shots, poses, strict=True):
        light = full.render(shot, pose)
        assert np.isfinite(light).all()
        assert (light >= 0).all()
        for other in others:
            assert other.render(shot, pose).tobytes() == light.tobytes()
        seen.append(light.copy())
    return seen


def sphere_mesh(rows: int, radius: float) -> Mesh:
    """A closed ball of 4 rows^2 triangles, most of them tiny."""
    tall, around = np.linspace(0, np.pi, rows + 1), 2 * np.pi * np.arange(2 * rows) / (2 * rows)
    a, b = np.meshgrid(tall, around, indexing="ij")
    vertices = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], -1)
    index = np.arange((rows + 1) * 2 * rows).reshape(rows + 1, 2 * rows)
    p, q = index[:-1], np.roll(index, -1, 1)[:-1]
    r, s = np.roll(index, -1, 1)[1:], index[1:]
    faces = np.concatenate([np.stack([p, s, r], -1), np.stack([p, r, q], -1)]).reshape(-1, 3)
    return Mesh((vertices.reshape(-1, 3) * radius).astype(np.float32), faces.astype(np.int32))


@pytest.mark.parametrize("metres", [0.3, 1.0, 4.0, 20.0, 100.0, 1000.0])
def test_no_ray_slips_between_the_triangles_of_a_mesh(metres: float) -> None:
    # before: 20 pinholes in half a million rays at 1 m, 55 at 4 m, 15,000 at 1 km
    radius, size = 0.1, 300
    scene = scene_of([Shape.MESH], [[radius] * 3], meshes=(sphere_mesh(200, radius),))
    # the ball's rim stays outside the picture
    inside = radius * np.sqrt(1 - (radius / metres) ** 2)
    focal = size / 2 / (0.98 * inside / np.sqrt(2) / metres)
    rng = np.random.default_rng(0)
    renderer = NativeRenderer(scene, camera_of(size, size, focal), RenderConfig(spp=1), 1)
    for _ in range(3):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn[:, 0] *= np.sign(np.linalg.det(turn))
        pose = CameraPose(turn[:, 2] * metres, turn.reshape(9))
        index, distance = renderer.hits(shot_of(scene, [[0, 0, 0]]), pose)
        assert (index == 0).all()
        np.testing.assert_allclose(distance.min(), metres - radius, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("tilt", [0.0, 0.1, 0.35, 0.7, 1.2, 2.0])
def test_an_orthographic_camera_keeps_what_its_mirrors_show(tilt: float) -> None:
    # every mirrored ray runs the same way: once their cosine of 1 and a bit said "no mirror"
    turn = np.array([np.cos(tilt), 0, np.sin(tilt), 0, 1, 0, -np.sin(tilt), 0, np.cos(tilt)])
    scene = scene_of(
        [Shape.BOX, Shape.SPHERE],
        [[1, 1, 0.05], [0.2, 0, 0]],
        surfaces=(MIRROR, GLOW),
        surface=[0, 1],
    )
    # where the mirror sends what comes from above
    normal = turn.reshape(3, 3) @ [0, 0, 1]
    out = np.array([0, 0, -1]) + 2 * normal[2] * normal
    places = [[[0, 0, 0], out * 1.6 + [0, 0.02 * tick, 0]] for tick in range(12)]
    mats = np.stack([turn, EYE])
    shots = [shot_of(scene, place, mats) for place in places]
    light = everywhere(scene, camera_of(48, 48, 20, True), shots, [looking_down(5.0)] * 12)
    assert all((a != b).any() for a, b in zip(light[1:], light[:-1], strict=True))


@pytest.mark.parametrize("zoom", [10.0, 1e3, 1e5])
def test_a_mirror_in_a_long_lens_shows_what_moves(zoom: float) -> None:
    scene = scene_of(
        [Shape.PLANE, *[Shape.SPHERE] * 20],
        [[0, 0, 1], *[[0.02, 0, 0]] * 20],
        surfaces=(MIRROR, GLOW),
        surface=[0] + [1] * 20,
    )
    rng = np.random.default_rng(1)
    places = np.concatenate([[[0, 0, 0]], rng.uniform(-0.5, 0.5, (20, 3)) + [0, 8 / 3, 2]])
    # looks at the middle of the mirror; the balls are where that sends the rays
    steep = np.array([1, 0, 0, 0, 0.6, -0.8, 0, 0.8, 0.6])
    pose = CameraPose(np.array([0, -0.8, 0.6]) * zoom, steep)
    shots = []
    for _ in range(10):
        places[1:] += rng.normal(size=(20, 3)) * 0.01
        shots.append(shot_of(scene, places.copy()))
    light = everywhere(scene, camera_of(64, 48, 40 * zoom), shots, [pose] * 10)
    assert light[0].max() > 0
    assert any((a != b).any() for a, b in zip(light[1:], light[:-1], strict=True))


@pytest.mark.parametrize("fovy", [170.0, 179.0, 179.9])
@pytest.mark.parametrize("size", [(1, 1), (3, 3), (5, 2)])
def test_packets_wider_than_a_right_angle_lose_nothing(
    fovy: float, size: tuple[int, int], camera_rays: Callable[[CameraModel], np.ndarray]
) -> None:
    # a ring of balls all around; in the larger picture each packet sees its own part
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    places = np.stack([3 * np.cos(angle), 3 * np.sin(angle), -0.3 - 0 * angle], 1)
    scene = scene_of([Shape.SPHERE] * 40, [[0.24, 0, 0]] * 40, surfaces=(GLOW,))
    width, height = size
    focal = height / 2 / np.tan(np.deg2rad(fovy) / 2)
    camera = camera_of(width, height, focal)
    renderer = NativeRenderer(scene, camera, RenderConfig(spp=1), 1)
    index, _ = renderer.hits(shot_of(scene, places), looking_down(0.0))
    # against rays and spheres in NumPy
    d = camera_rays(camera)
    along = d @ places.T
    off = np.linalg.norm(places - along[..., np.newaxis] * d[..., np.newaxis, :], axis=-1)
    hit = (off < 0.24) & (along > 0)
    expected = np.where(hit.any(-1), np.argmin(np.where(hit, along, np.inf), -1), -1)
    np.testing.assert_array_equal(index, expected)


def test_a_geom_whose_pose_turns_nan_is_gone_at_once_and_back_at_once() -> None:
    scene = scene_of([Shape.PLANE, Shape.SPHERE], [[0, 0, 1], [0.4, 0, 0]])
    camera = camera_of(40, 30, 30)
    kept = NativeRenderer(scene, camera, RenderConfig(spp=1), 1)
    full = NativeRenderer(scene, camera, RenderConfig(spp=1, incremental=False), 1)
    shots = [
        shot_of(scene, [[0, 0, 0], [0, 0, z]]) for z in (1.0, np.nan, np.nan, 1.0, np.inf, 1.0)
    ]
    for shot in shots:
        np.testing.assert_array_equal(
            kept.render(shot, looking_down(4)), full.render(shot, looking_down(4))
        )


def test_nothing_and_nobody_to_light_it() -> None:
    empty = scene_of([], [], lights=())
    (light,) = everywhere(empty, camera_of(9, 5, 4), [shot_of(empty, [])], [looking_down(1)])
    assert (light == 0).all()
    dark = scene_of([Shape.SPHERE], [[1, 0, 0]], lights=())
    shots = [shot_of(dark, [[0, 0, z]]) for z in (0, 0.1)]
    for light in everywhere(dark, camera_of(9, 5, 4), shots, [looking_down(3)] * 2):
        assert (light == 0).all()


def test_two_thousand_geoms_and_a_hundred_lights() -> None:
    rng = np.random.default_rng(3)
    count = 2000
    shapes = [Shape(int(s)) for s in rng.choice([2, 3, 4, 5, 6], count)]
    lights = tuple(
        Light(LightKind(k % 3), diffuse=(0.01,) * 3, castshadow=k % 4 == 0) for k in range(100)
    )
    scene = scene_of(shapes, rng.uniform(0.02, 0.06, (count, 3)).tolist(), lights=lights)
    places = rng.uniform(-1, 1, (count, 3))
    lamps = rng.uniform(-3, 3, (100, 3))
    shots = []
    for _ in range(3):
        places[rng.integers(0, count, 5)] += 0.02
        shots.append(shot_of(scene, places.copy(), lamps=lamps))
    light = everywhere(scene, camera_of(32, 24, 24), shots, [looking_down(3)] * 3)
    assert light[0].max() > 0


@pytest.mark.parametrize("radius", [1e-6, 1e-3, 1e3, 1e5])
@pytest.mark.parametrize("shape", [Shape.SPHERE, Shape.CAPSULE, Shape.ELLIPSOID, Shape.CYLINDER,
                                   Shape.BOX])  # fmt: skip
def test_sizes_from_a_micrometre_to_a_hundred_kilometres(shape: Shape, radius: float) -> None:
    scene = scene_of([shape], [[radius] * 3])
    poses = [looking_down(4 * radius), looking_down(3.9 * radius)] * 2
    shots = [shot_of(scene, [[0, 0, 0]])] * 4
    light = everywhere(scene, camera_of(32, 32, 32), shots, poses)
    assert light[0][16, 16] > 0
    renderer = NativeRenderer(scene, camera_of(32, 32, 32), RenderConfig(spp=1), 1)
    index, distance = renderer.hits(shots[0], poses[0])
    top = {Shape.CAPSULE: 2.0}.get(shape, 1.0)
    assert 0.1 < (index == 0).mean() < 1
    np.testing.assert_allclose(distance[16, 16], (4 - top) * radius, rtol=0.02)


def test_mirrors_that_face_each_other() -> None:
    up_side_down = np.array([1, 0, 0, 0, -1, 0, 0, 0, -1])
    scene = scene_of(
        [Shape.PLANE, Shape.PLANE, Shape.SPHERE],
        [[0, 0, 1], [0, 0, 1], [0.2, 0, 0]],
        surfaces=(MIRROR, GLOW),
        surface=[0, 0, 1],
    )
    steep = np.array([1, 0, 0, 0, 0.6, -0.8, 0, 0.8, 0.6])
    shots = [
        shot_of(scene, [[0, 0, 0], [0, 0, 2], [0.05 * k, 0, 1]], np.stack([EYE, up_side_down, EYE]))
        for k in range(4)
    ]
    pose = CameraPose(np.array([0, -1.5, 1.9]), steep)
    light = everywhere(scene, camera_of(48, 40, 30), shots, [pose] * 4)
    assert (light[0] != light[1]).any()


@pytest.mark.parametrize("place", [(0, 0, 0), (0, 0, 0.5), (0.5, 0.5, 0.5), (0, 0, 1e-30)])
@pytest.mark.parametrize("shape", list(Shape))
def test_a_camera_on_and_inside_a_shape(shape: Shape, place: tuple[float, float, float]) -> None:
    if shape is Shape.HFIELD:
        shape = Shape.MESH
    scene = scene_of([shape, Shape.BOX], [[0.5, 0.5, 0.5], [9, 9, 0.1]],
                     meshes=(sphere_mesh(8, 0.5),))  # fmt: skip
    shots = [shot_of(scene, [[0, 0, 0], [0, 0, -3 - 0.1 * k]]) for k in range(3)]
    x, y, z = place
    for camera in (camera_of(17, 13, 9), camera_of(17, 13, 9, True)):
        everywhere(scene, camera, shots, [looking_down(z, x, y)] * 3)
    # a closed shape around the camera is not seen
    if place == (0, 0, 0):
        renderer = NativeRenderer(scene, camera_of(17, 13, 9), RenderConfig(spp=1), 1)
        assert (renderer.hits(shots[0], looking_down(0.0))[0] != 0).all()


@pytest.mark.parametrize("cutoff", [0.0, 90.0, 180.0])
@pytest.mark.parametrize("exponent", [0.0, 1e-3, 128.0])
def test_spots_of_any_angle_and_lights_in_odd_places(cutoff: float, exponent: float) -> None:
    lamps = [[0, 0, 0], [0, 0, 1e-12], [0, 0, 3], [1e9, 0, 1e9], [0, 0, -1]]
    kinds = (LightKind.SPOT, LightKind.POINT, LightKind.SPOT, LightKind.POINT, LightKind.SPOT)
    lights = tuple(
        Light(kind, cutoff_deg=cutoff, exponent=exponent, attenuation=(0.0, 0.0, 0.0))
        for kind in kinds
    )
    scene = scene_of([Shape.PLANE, Shape.SPHERE], [[0, 0, 1], [0.3, 0, 0]], lights=lights)
    shots = [shot_of(scene, [[0, 0, 0], [0.1 * k, 0, 1]], lamps=lamps) for k in range(3)]
    everywhere(scene, camera_of(33, 25, 20), shots, [looking_down(4)] * 3)
    everywhere(scene, camera_of(33, 25, 20, True), shots, [looking_down(4)] * 3)


def test_rays_along_axes_and_faces() -> None:
    # orthographic rays that run along a cylinder's side, a box's face and a capsule's axis
    shapes = [Shape.CYLINDER, Shape.BOX, Shape.CAPSULE, Shape.CYLINDER]
    scene = scene_of(shapes, [[0.25, 0.5, 0], [0.25, 0.25, 0.5], [0.25, 0.5, 0], [0.25, 0.5, 0]])
    places = [[-1.5, 0, 0], [-0.5, 0, 0], [0.5, 0, 0], [1.5, 0, 0]]
    # the last lies down
    mats = np.stack([EYE, EYE, EYE, [1, 0, 0, 0, 0, 1, 0, -1, 0]])
    # 8 px a m: pixels' centres are odd sixteenths, so that no ray lies on a face ...
    renderer = NativeRenderer(scene, camera_of(32, 8, 8, True), RenderConfig(spp=1), 1)
    index, distance = renderer.hits(shot_of(scene, places, mats), looking_down(3))
    assert set(np.unique(index)) == {-1, 0, 1, 2, 3}
    np.testing.assert_array_equal(distance[index == 0], 2.5)
    np.testing.assert_array_equal(distance[index == 1], 2.5)
    assert (index == 1).sum() == 16
    assert (index == 3).sum() == 4 * 8
    # ... and 16 px a m shifted by half a pixel: every fourth one does, and is in or out, not NaN
    camera = replace(camera_of(64, 16, 16, True), cx=31.5, cy=7.5)
    (light,) = everywhere(scene, camera, [shot_of(scene, places, mats)], [looking_down(3)])
    assert light.max() > 0


DEGENERATE = {
    "points": np.zeros((9, 3)),
    "a line": np.linspace(0, 1, 9)[:, np.newaxis] * [1, 0, 0],
    "denormal": np.random.default_rng(0).normal(size=(9, 3)) * 1e-41,
    "flat but for denormals": np.random.default_rng(0).normal(size=(9, 3)) * [1, 1, 1e-40],
    "huge": np.random.default_rng(0).normal(size=(9, 3)) * 1e37,
    "at the limit": np.sign(np.random.default_rng(0).normal(size=(9, 3))) * 3.4e38,
    "far from its origin": np.random.default_rng(0).normal(size=(9, 3)) + 1e7,
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_meshes_without_form(name: str) -> None:
    vertices = DEGENERATE[name].astype(np.float32)
    rng = np.random.default_rng(1)
    faces = rng.integers(0, len(vertices), (200, 3)).astype(np.int32)
    scene = scene_of([Shape.MESH, Shape.PLANE], [[1] * 3, [0, 0, 1]],
                     meshes=(Mesh(vertices, faces),))  # fmt: skip
    shots = [shot_of(scene, [[0.01 * k, 0, 1], [0, 0, 0]]) for k in range(3)]
    everywhere(scene, camera_of(24, 20, 16), shots, [looking_down(4)] * 3)


@pytest.mark.parametrize("size", [(1, 4096), (4096, 1), (2, 2), (1, 1), (4097, 3)])
def test_slim_sensors(size: tuple[int, int]) -> None:
    scene = scene_of([Shape.PLANE, Shape.SPHERE], [[0, 0, 1], [0.5, 0, 0]])
    shots = [shot_of(scene, [[0, 0, 0], [0, 0, 1 + 0.1 * k]]) for k in range(2)]
    light = everywhere(scene, camera_of(*size, max(size) / 2), shots, [looking_down(4)] * 2)
    assert light[0].shape == size[::-1]
    assert light[0].max() > 0


def test_a_skybox_without_six_faces_and_a_giant_texture_are_refused() -> None:
    flat = Texture(TextureKind.FLAT, np.zeros((4, 4, 3), np.uint8))
    scene = replace(scene_of([Shape.SPHERE], [[1, 0, 0]]), textures=(flat,), skybox=0)
    with pytest.raises(ValueError, match="six faces"):
        NativeRenderer(scene, camera_of(4, 4, 4), RenderConfig(), 1)
    data = _core.SceneData()
    with pytest.raises(ValueError, match="smaller than"):
        data.add_texture(np.zeros((1, 1 << 15, 1, 1), np.uint8), True)


def test_a_shadow_ray_may_meet_what_the_surface_itself_hides() -> None:
    # a lamp touching the floor, a lamp inside a ball, a lamp in the plane of a wall
    lamps = [[0.5, 0, 0], [0, 0, 0.5], [1, 0, 1]]
    lights = tuple(Light(LightKind.POINT, attenuation=(1.0, 0.0, 0.0)) for _ in lamps)
    scene = scene_of(
        [Shape.PLANE, Shape.SPHERE, Shape.BOX],
        [[0, 0, 1], [0.3, 0, 0], [0.5, 0.01, 0.5]],
        lights=lights,
    )
    shots = [shot_of(scene, [[0, 0, 0], [0, 0, 0.5], [1, 0.02 * k, 0.5]], lamps=lamps)
             for k in range(3)]  # fmt: skip
    everywhere(scene, camera_of(40, 30, 20), shots, [looking_down(4)] * 3)


def test_a_negative_shininess_counts_as_none() -> None:
    # once 2^4000 of garbage, some of it negative
    lights = (Light(LightKind.POINT, attenuation=(1.0, 0.0, 0.0)),)
    seen = []
    for shininess in (-1.0, 0.0):
        scene = scene_of([Shape.PLANE, Shape.SPHERE], [[0, 0, 1], [0.5, 0, 0]],
                         surfaces=(Surface(shininess=shininess),), lights=lights)  # fmt: skip
        shot = shot_of(scene, [[0, 0, 0], [0, 0, 1]])
        seen += everywhere(scene, camera_of(24, 20, 16), [shot], [looking_down(4)])
    np.testing.assert_array_equal(*seen)
